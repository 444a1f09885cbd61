/* DeltaPlant: three drives that follow the reference they were given at the communication point, and the robot they move. */
#include "plant.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "fmi/model.h"
#include "robot_variables.h"

/* Samples of the drives in a step: MODEL_STEP / DRIVE_PERIOD. */
enum { SAMPLES = 8 };

/* No input or drive parameter of a robot is greater, in SI units; within it all arithmetic stays finite. */
static const double greatest = 1e9;

static double bounded(double x)
{
    return x > greatest ? greatest : x < -greatest ? -greatest : x;
}

/* ---- Start ------------------------------------------------------------------------------------------------------------------- */

static int refuse(const ModelLog *log, const char *sentence)
{
    log->write(log->context, MESSAGE_ERROR, sentence);
    return 0;
}

static int refuse_verdict(const ModelLog *log, const char *what, const dph_verdict *verdict)
{
    char reason[256], sentence[320];
    dph_verdict_text(verdict, reason, (int)sizeof reason);
    snprintf(sentence, sizeof sentence, "%s: %s", what, reason);
    return refuse(log, sentence);
}

/* What the variable table bounds on one side only. */
static int drive_is_legal(const Variables *v, const ModelLog *log)
{
    const struct {
        const char *name;
        double value;
    } parameters[] = {
        {"drive.gear_ratio", v->drive_gear_ratio},
        {"drive.coulomb_friction", v->drive_coulomb_friction},
        {"drive.viscous_friction", v->drive_viscous_friction},
        {"drive.torque_max", v->drive_torque_max},
        {"drive.speed_max", v->drive_speed_max},
        {"drive.torque_time_constant", v->drive_torque_time_constant},
        {"drive.nominal_inertia", v->drive_nominal_inertia},
        {"drive.position_gain", v->drive_position_gain},
        {"drive.velocity_bandwidth", v->drive_velocity_bandwidth},
        {"drive.integral_time", v->drive_integral_time},
        {"trip_threshold.position_deviation", v->trip_threshold_position_deviation},
        {"trip_threshold.overspeed", v->trip_threshold_overspeed},
    };
    for (size_t i = 0; i < sizeof parameters / sizeof *parameters; ++i) {
        if (!(parameters[i].value <= greatest)) {
            char sentence[160];
            snprintf(sentence, sizeof sentence, "%s is %g: at most %g", parameters[i].name, parameters[i].value, greatest);
            return refuse(log, sentence);
        }
    }
    return 1;
}

/* ---- Inputs and outputs ------------------------------------------------------------------------------------------------------ */

/* The reference some time [s] after the communication point: theta + w t + a t^2 / 2. */
static Reference reference_after(const Variables *v, int i, double t)
{
    double velocity = bounded(v->joint_velocity_ref[i]), acceleration = bounded(v->joint_acceleration_ref[i]);
    Reference reference = {
        .position = bounded(v->joint_position_ref[i]) + t * (velocity + 0.5 * t * acceleration),
        .velocity = velocity + t * acceleration,
        .torque = bounded(v->joint_torque_ff[i]),
    };
    return reference;
}

/* Distance of the tool centre point from where the reference joints would have it; the last one where they have it nowhere. */
static void write_tcp_error(Model *m, const double reference[3])
{
    double point[3];
    if (!dph_forward_kinematics(&m->mechanism.robot, reference, point))
        return;
    double square = 0.0;
    for (int i = 0; i < 3; ++i)
        square += (point[i] - m->mechanism.motion.point[i]) * (point[i] - m->mechanism.motion.point[i]);
    m->v.tcp_tracking_error = sqrt(square);
}

/* Outputs some time [s] after the communication point at which the inputs were set. */
static void write_outputs(Model *m, double since_inputs)
{
    Variables *v = &m->v;
    const dph_motion *motion = &m->mechanism.motion;
    memcpy(v->joint_position, motion->theta, sizeof v->joint_position);
    memcpy(v->joint_velocity, motion->theta_d, sizeof v->joint_velocity);
    memcpy(v->joint_acceleration, motion->theta_dd, sizeof v->joint_acceleration);
    memcpy(v->joint_torque, motion->torque, sizeof v->joint_torque);
    memcpy(v->tcp_position, motion->point, sizeof v->tcp_position);
    memcpy(v->tcp_velocity, motion->point_d, sizeof v->tcp_velocity);
    double reference[3];
    for (int i = 0; i < 3; ++i) {
        v->motor_torque[i] = m->mechanism.locked ? 0.0 : axis_torque(&m->drive, &m->axis[i], 2);
        v->motor_speed[i] = m->drive.gear_ratio * motion->theta_d[i];
        v->rod_force[i] = motion->lambda[i] * m->mechanism.robot.forearm_length;
        reference[i] = reference_after(v, i, since_inputs).position;
        v->joint_tracking_error[i] = reference[i] - motion->theta[i];
    }
    write_tcp_error(m, reference);
}

int model_initialize(void *model, const ModelLog *log)
{
    Model *m = model;
    Variables *v = &m->v;
    m->mechanism.robot = robot_from(v);
    dph_verdict verdict = dph_robot_check(&m->mechanism.robot);
    if (verdict.status != DPH_STATUS_OK)
        return refuse_verdict(log, "no robot", &verdict);
    if (!drive_is_legal(v, log))
        return 0;

    double theta[3];
    verdict = dph_inverse_kinematics(&m->mechanism.robot, v->start, theta);
    if (verdict.status == DPH_STATUS_OK) {
        m->drive = drive_from(v);
        m->mechanism.payload = bounded(v->payload_mass);
        verdict = mechanism_start(&m->mechanism, &m->drive, theta, v->start);
    }
    if (verdict.status != DPH_STATUS_OK)
        return refuse_verdict(log, "the robot cannot start at start.x, start.y, start.z", &verdict);

    for (int i = 0; i < 3; ++i)
        axis_start(&m->drive, &m->axis[i], theta[i], m->mechanism.motion.torque[i], reference_after(v, i, 0.0).torque);
    m->steps = 0;
    v->trip = TRIP_NONE;
    v->tcp_tracking_error = 0.0;
    write_outputs(m, 0.0);
    return 1;
}

/* ---- Trips ------------------------------------------------------------------------------------------------------------------- */

/* Trips latch: drives off, brakes on. Only the first one counts. */
static void trip(Model *m, int32_t reason, const char *sentence, double steps, const ModelLog *log)
{
    char text[400];
    snprintf(text, sizeof text, "tripped after %.3f steps of %g ms: %s", steps, 1e3 * MODEL_STEP, sentence);
    log->write(log->context, MESSAGE_WARNING, text);
    m->v.trip = reason;
    m->mechanism.braked = 1;
}

/* The mechanism can go no further: it stands where it was. */
static void stop(Model *m, const dph_verdict *verdict, double steps, const ModelLog *log)
{
    char sentence[256];
    if (verdict->status == DPH_STATUS_JOINT_RANGE)
        snprintf(sentence, sizeof sentence, "joint %d has come to %.4g rad, where its travel ends at %.4g rad", verdict->joint,
                 verdict->required, verdict->available);
    else
        dph_verdict_text(verdict, sentence, (int)sizeof sentence);
    if (m->v.trip == TRIP_NONE)
        trip(m, TRIP_KINEMATICS, sentence, steps, log);
    mechanism_lock(&m->mechanism);
}

/* Deviation and overspeed, watched by the drives at their samples. */
static void watch(Model *m, const Reference reference[3], double steps, const ModelLog *log)
{
    const Variables *v = &m->v;
    const dph_motion *motion = &m->mechanism.motion;
    double speed_limit = v->trip_threshold_overspeed * m->drive.speed_max;
    char sentence[160];
    for (int i = 0; i < 3; ++i) {
        double deviation = fabs(reference[i].position - motion->theta[i]), speed = fabs(m->drive.gear_ratio * motion->theta_d[i]);
        if (!(deviation <= v->trip_threshold_position_deviation)) {
            snprintf(sentence, sizeof sentence, "joint %d is %.4g rad away from its reference, at most %.4g rad are allowed", i + 1,
                     deviation, v->trip_threshold_position_deviation);
            trip(m, TRIP_POSITION_DEVIATION, sentence, steps, log);
            return;
        }
        if (!(speed <= speed_limit)) {
            snprintf(sentence, sizeof sentence, "motor %d runs at %.4g rad/s, at most %.4g rad/s are allowed", i + 1, speed,
                     speed_limit);
            trip(m, TRIP_OVERSPEED, sentence, steps, log);
            return;
        }
    }
}

/* ---- Steps ------------------------------------------------------------------------------------------------------------------- */

/* One period of the drives that begins some samples after the communication point. */
static void run_period(Model *m, uint64_t sample, const ModelLog *log)
{
    Mechanism *mechanism = &m->mechanism;
    double steps = (double)m->steps + (double)sample / SAMPLES;
    dph_verdict verdict = {DPH_STATUS_OK, DPH_PHASE_IDLE, 0, 0.0, 0.0};
    Reference reference[3];
    for (int i = 0; i < 3; ++i)
        reference[i] = reference_after(&m->v, i, (double)sample * DRIVE_PERIOD);
    if (m->v.trip == TRIP_NONE) {
        watch(m, reference, steps, log);
        if (m->v.trip != TRIP_NONE)
            verdict = mechanism_update(mechanism, &m->drive, m->axis, 2);
    }
    for (int i = 0; i < 3; ++i) {
        if (m->v.trip == TRIP_NONE)
            axis_sample(&m->drive, &m->axis[i], &reference[i], mechanism->motion.theta[i]);
        else
            axis_off(&m->drive, &m->axis[i]);
    }
    if (verdict.status == DPH_STATUS_OK)
        verdict = mechanism_advance(mechanism, &m->drive, m->axis);
    if (verdict.status != DPH_STATUS_OK)
        stop(m, &verdict, steps, log);
    else if (mechanism_is_caught(mechanism))
        mechanism_lock(mechanism);
}

void model_step(void *model, uint32_t n, const ModelLog *log)
{
    Model *m = model;
    m->mechanism.payload = bounded(m->v.payload_mass);
    dph_verdict verdict = mechanism_update(&m->mechanism, &m->drive, m->axis, 2);
    if (verdict.status != DPH_STATUS_OK)
        stop(m, &verdict, (double)m->steps, log);
    for (uint64_t sample = 0; sample < (uint64_t)n * SAMPLES && !m->mechanism.locked; ++sample)
        run_period(m, sample, log);
    m->steps += n;
    write_outputs(m, n * MODEL_STEP);
}
