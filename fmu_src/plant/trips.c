/* Trips: the first one counts, says why and where, and latches. */
#include "trips.h"

#include <math.h>
#include <stdio.h>

static void trip(Model *m, int32_t reason, int axis, const char *sentence, double steps, const ModelLog *log)
{
    char text[400];
    snprintf(text, sizeof text, "tripped after %.3f steps of %g ms: %s", steps, 1e3 * MODEL_STEP, sentence);
    log->write(log->context, MESSAGE_WARNING, text);
    m->v.trip = reason;
    m->v.trip_axis = axis;
    m->v.trip_time = steps * MODEL_STEP;
    m->mechanism.braked = 1;
}

/* A quantity of one axis with its threshold; `sentence` takes the axis, the value and the threshold. */
typedef struct {
    int32_t reason;
    double value, threshold;
    const char *sentence;
} Watch;

/* How far a joint is beyond its range [rad]. */
static double beyond_range(const dph_robot *robot, double theta)
{
    return fmax(robot->joint_position_min - theta, theta - robot->joint_position_max);
}

static int watch_axis(Model *m, int i, const Reference *reference, double steps, const ModelLog *log)
{
    const Variables *v = &m->v;
    const Drive *drive = &m->drive;
    const Axis *axis = &m->axis[i];
    double theta = m->mechanism.motion.theta[i], speed = drive->gear_ratio * m->mechanism.motion.theta_d[i];
    double deviation = v->servo_on ? fabs(reference->position - axis_position(drive, axis)) : 0.0;
    const Watch watches[] = {
        {TRIP_ENCODER, fabs(axis->zero + axis->angle - drive->gear_ratio * theta), v->trip_threshold_encoder + drive->quantum,
         "encoder %d is %.4g rad off, at most %.4g rad are allowed"},
        {TRIP_JOINT_RANGE, beyond_range(&m->mechanism.robot, theta), v->trip_threshold_joint_range,
         "joint %d is %.4g rad outside its range, at most %.4g rad are allowed"},
        {TRIP_POSITION_DEVIATION, deviation, v->trip_threshold_position_deviation,
         "joint %d is %.4g rad away from its reference, at most %.4g rad are allowed"},
        {TRIP_OVERSPEED, fabs(speed), v->trip_threshold_overspeed * drive->speed_max,
         "motor %d runs at %.4g rad/s, at most %.4g rad/s are allowed"},
        {TRIP_OVERLOAD, m->load[i].thermal, v->trip_threshold_overload,
         "motor %d has %.4g times the load it stands in the long run, at most %.4g times are allowed"},
    };
    for (size_t k = 0; k < sizeof watches / sizeof *watches; ++k) {
        if (!(watches[k].value <= watches[k].threshold)) {
            char sentence[200];
            snprintf(sentence, sizeof sentence, watches[k].sentence, i + 1, watches[k].value, watches[k].threshold);
            trip(m, watches[k].reason, i + 1, sentence, steps, log);
            return 1;
        }
    }
    return 0;
}

void trips_watch(Model *m, const Reference reference[3], double steps, const ModelLog *log)
{
    const dph_motion *motion = &m->mechanism.motion;
    for (int i = 0; i < 3; ++i)
        if (watch_axis(m, i, &reference[i], steps, log))
            return;
    double residual = dph_closure_residual(&m->mechanism.robot, motion->theta, motion->point);
    if (!(residual <= m->v.trip_threshold_constraint)) {
        char sentence[160];
        snprintf(sentence, sizeof sentence, "a rod misses its length by %.4g m, at most %.4g m are allowed", residual,
                 m->v.trip_threshold_constraint);
        trip(m, TRIP_CONSTRAINT, 0, sentence, steps, log);
    }
}

void trips_stop(Model *m, const dph_verdict *verdict, double steps, const ModelLog *log)
{
    char sentence[256];
    int32_t reason = verdict->status == DPH_STATUS_SINGULAR && verdict->available > 0.0 ? TRIP_SINGULARITY : TRIP_KINEMATICS;
    if (verdict->status == DPH_STATUS_JOINT_RANGE) {
        reason = TRIP_JOINT_RANGE;
        snprintf(sentence, sizeof sentence, "joint %d has come to %.4g rad, where its travel ends at %.4g rad", verdict->joint,
                 verdict->required, verdict->available);
    } else {
        dph_verdict_text(verdict, sentence, (int)sizeof sentence);
    }
    if (m->v.trip == TRIP_NONE)
        trip(m, reason, verdict->joint, sentence, steps, log);
    mechanism_lock(&m->mechanism);
}
