/* DeltaPlant: three drives that follow the reference they were given at the communication point, and the robot they move. */
#include "plant.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "fmi/model.h"
#include "robot_variables.h"
#include "trips.h"

/* Samples of the drives in a step: MODEL_STEP / DRIVE_PERIOD. */
enum { SAMPLES_PER_STEP = 8 };

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
        {"drive.torque_rated", v->drive_torque_rated},
        {"drive.thermal_time_constant", v->drive_thermal_time_constant},
        {"trip_threshold.overload", v->trip_threshold_overload},
        {"trip_threshold.encoder", v->trip_threshold_encoder},
        {"trip_threshold.joint_range", v->trip_threshold_joint_range},
        {"trip_threshold.constraint", v->trip_threshold_constraint},
        {"hard_stop.clearance", v->hard_stop_clearance},
        {"hard_stop.stiffness", v->hard_stop_stiffness},
        {"hard_stop.damping", v->hard_stop_damping},
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

/* What the inputs say of faults, disturbances and brakes. */
static void read_faults(Model *m)
{
    const Variables *v = &m->v;
    for (int i = 0; i < 3; ++i) {
        Fault fault = {
            .torque_limit = v->motor_torque_limit[i],
            .torque_gain = v->motor_torque_gain[i],
            .encoder_offset = bounded(v->encoder_offset[i]),
            .encoder_stuck = v->encoder_stuck[i],
        };
        m->fault[i] = fault;
        m->mechanism.force[i] = bounded(v->tcp_force[i]);
    }
    if (v->trip == TRIP_NONE) {
        m->mechanism.braked = v->brake;
        m->mechanism.locked = m->mechanism.locked && v->brake && !v->servo_on;
    }
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
        v->motor_power[i] = v->motor_torque[i] * v->motor_speed[i];
        v->motor_torque_rms[i] = m->load[i].time > 0.0 ? sqrt(m->load[i].square / m->load[i].time) : 0.0;
        v->motor_load[i] = m->load[i].thermal;
        v->motor_work[i] = m->load[i].work;
        v->motor_regenerated[i] = m->load[i].regenerated;
        v->joint_work[i] = m->mechanism.joint_energy[i];
        reference[i] = reference_after(v, i, since_inputs).position;
        v->joint_tracking_error[i] = reference[i] - motion->theta[i];
    }
    v->constraint_residual = dph_closure_residual(&m->mechanism.robot, motion->theta, motion->point);
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
        m->mechanism.stop_stiffness = v->hard_stop_stiffness;
        m->mechanism.stop_damping = v->hard_stop_damping;
        m->mechanism.stop_angle[0] = v->robot_joint_position_min - v->hard_stop_clearance;
        m->mechanism.stop_angle[1] = v->robot_joint_position_max + v->hard_stop_clearance;
        v->trip = TRIP_NONE;
        read_faults(m);
        verdict = mechanism_start(&m->mechanism, &m->drive, theta, v->start);
    }
    if (verdict.status != DPH_STATUS_OK)
        return refuse_verdict(log, "the robot cannot start at start.x, start.y, start.z", &verdict);

    for (int i = 0; i < 3; ++i)
        axis_start(&m->drive, &m->axis[i], theta[i], m->mechanism.motion.torque[i], reference_after(v, i, 0.0).torque);
    memset(m->load, 0, sizeof m->load);
    m->steps = 0;
    v->trip_axis = 0;
    v->trip_time = v->tcp_tracking_error = 0.0;
    write_outputs(m, 0.0);
    return 1;
}

/* ---- Steps ------------------------------------------------------------------------------------------------------------------- */

/* One period of the drives that begins some samples after the communication point. */
static void run_period(Model *m, uint64_t sample, const ModelLog *log)
{
    Mechanism *mechanism = &m->mechanism;
    double steps = (double)m->steps + (double)sample / SAMPLES_PER_STEP;
    double energy[3] = {0.0, 0.0, 0.0};
    dph_verdict verdict = {DPH_STATUS_OK, DPH_PHASE_IDLE, 0, 0.0, 0.0};
    Reference reference[3];
    for (int i = 0; i < 3; ++i) {
        reference[i] = reference_after(&m->v, i, (double)sample * DRIVE_PERIOD);
        axis_read(&m->drive, &m->axis[i], &m->fault[i], mechanism->motion.theta[i]);
    }
    if (m->v.trip == TRIP_NONE) {
        trips_watch(m, reference, steps, log);
        if (m->v.trip != TRIP_NONE)
            verdict = mechanism_update(mechanism, &m->drive, m->axis, 2);
    }
    for (int i = 0; i < 3; ++i) {
        if (m->v.trip == TRIP_NONE && m->v.servo_on)
            axis_control(&m->drive, &m->axis[i], &m->fault[i], &reference[i]);
        else
            axis_off(&m->drive, &m->axis[i]);
    }
    if (verdict.status == DPH_STATUS_OK && !mechanism->locked)
        verdict = mechanism_advance(mechanism, &m->drive, m->axis, energy);
    for (int i = 0; i < 3; ++i)
        load_add(&m->drive, &m->axis[i], energy[i], &m->load[i]);
    if (verdict.status != DPH_STATUS_OK)
        trips_stop(m, &verdict, steps, log);
    else if ((m->v.trip != TRIP_NONE || !m->v.servo_on) && !mechanism->locked && mechanism_is_caught(mechanism))
        mechanism_lock(mechanism);
}

void model_step(void *model, uint32_t n, const ModelLog *log)
{
    Model *m = model;
    read_faults(m);
    dph_verdict verdict = mechanism_load(&m->mechanism, bounded(m->v.payload_mass));
    if (verdict.status == DPH_STATUS_OK)
        verdict = mechanism_update(&m->mechanism, &m->drive, m->axis, 2);
    if (verdict.status != DPH_STATUS_OK)
        trips_stop(m, &verdict, (double)m->steps, log);
    for (uint64_t sample = 0; sample < (uint64_t)n * SAMPLES_PER_STEP; ++sample)
        run_period(m, sample, log);
    m->steps += n;
    write_outputs(m, n * MODEL_STEP);
}
