/* The moving robot: RK4 on the reduced equations of motion, brakes, hard stops, and the region in which the equations hold. */
#include "mechanism.h"

#include <math.h>
#include <string.h>

/* Least dexterity, half of what the planner asks for, and how far a joint may leave its range [rad]: what happens beyond is not the
 * mechanism's motion any more but a collision, or the assembly turned inside out. */
static const double least_dexterity = 0.05, overtravel = 0.2;

/* Static friction torque of a holding brake at the motor shaft [N m]: that of a 750 W motor. */
static const double motor_brake_torque = 2.45;

static dph_verdict accept(void)
{
    dph_verdict verdict = {DPH_STATUS_OK, DPH_PHASE_IDLE, 0, 0.0, 0.0};
    return verdict;
}

static dph_verdict singular(double dexterity)
{
    dph_verdict verdict = {DPH_STATUS_SINGULAR, DPH_PHASE_IDLE, 0, least_dexterity, dexterity};
    return verdict;
}

static dph_verdict region_check(const dph_robot *robot, const dph_motion *motion)
{
    for (int i = 0; i < 3; ++i) {
        double least = robot->joint_position_min - overtravel, most = robot->joint_position_max + overtravel;
        if (!(motion->theta[i] >= least && motion->theta[i] <= most)) {
            dph_verdict verdict = {DPH_STATUS_JOINT_RANGE, DPH_PHASE_IDLE, i + 1, motion->theta[i],
                                   motion->theta[i] < least ? least : most};
            return verdict;
        }
    }
    double dexterity = dph_dexterity(robot, motion->theta, motion->point);
    return dexterity >= least_dexterity ? accept() : singular(dexterity);
}

/* A spring and a damper behind the end of a joint's travel; they push, and never pull. */
static double stop_torque(const Mechanism *m, double theta, double theta_d)
{
    double depth = theta < m->stop_angle[0] ? theta - m->stop_angle[0] : theta > m->stop_angle[1] ? theta - m->stop_angle[1] : 0.0;
    double torque = -m->stop_stiffness * depth - m->stop_damping * theta_d;
    return torque * depth < 0.0 ? torque : 0.0;
}

/* Everything that follows from theta, theta_d and the time since the last sample. */
static int solve(const Mechanism *m, const Drive *drive, const Axis axis[3], int halves, dph_motion *motion)
{
    memcpy(motion->force, m->force, sizeof motion->force);
    for (int i = 0; i < 3; ++i) {
        motion->torque[i] = drive_joint_torque(drive, axis_torque(drive, &axis[i], halves), motion->theta_d[i]);
        motion->torque[i] += stop_torque(m, motion->theta[i], motion->theta_d[i]);
        if (m->braked)
            motion->torque[i] -= m->brake_torque * tanh(motion->theta_d[i] / m->brake_speed);
    }
    return dph_forward_dynamics(&m->robot, m->payload, motion);
}

/* At rest, held. */
static void rest(Mechanism *m)
{
    memset(m->motion.theta_d, 0, sizeof m->motion.theta_d);
    memset(m->motion.theta_dd, 0, sizeof m->motion.theta_dd);
    memset(m->motion.point_d, 0, sizeof m->motion.point_d);
    memset(m->motion.point_dd, 0, sizeof m->motion.point_dd);
    memcpy(m->motion.force, m->force, sizeof m->motion.force);
    dph_inverse_dynamics(&m->robot, m->payload, &m->motion);
}

dph_verdict mechanism_start(Mechanism *m, const Drive *drive, const double theta[3], const double point[3])
{
    memcpy(m->motion.theta, theta, sizeof m->motion.theta);
    memcpy(m->motion.point, point, sizeof m->motion.point);
    memset(m->joint_energy, 0, sizeof m->joint_energy);
    m->braked = m->locked = 0;
    /* Over the least inertia a joint can have, the brake's slope is 1 / DRIVE_PERIOD, the stop's damping at most half of that and its
     * stiffness at most (1 / DRIVE_PERIOD)^2 / 4: as steep as RK4 takes in its stride. */
    double rate = (m->robot.upper_arm_inertia + m->robot.drive_inertia) / DRIVE_PERIOD;
    m->brake_torque = drive->gear_ratio * motor_brake_torque;
    m->brake_speed = m->brake_torque / rate;
    m->stop_damping = fmin(m->stop_damping, 0.5 * rate);
    m->stop_stiffness = fmin(m->stop_stiffness, 0.25 * rate / DRIVE_PERIOD);
    rest(m);
    return region_check(&m->robot, &m->motion);
}

dph_verdict mechanism_load(Mechanism *m, double payload)
{
    double before = m->payload;
    m->payload = payload;
    if (payload > before && !dph_take_up(&m->robot, before, payload - before, &m->motion))
        return singular(0.0);
    return accept();
}

dph_verdict mechanism_update(Mechanism *m, const Drive *drive, const Axis axis[3], int halves)
{
    if (m->locked) {
        rest(m);
        return accept();
    }
    dph_motion motion = m->motion;
    if (!solve(m, drive, axis, halves, &motion))
        return singular(0.0);
    m->motion = motion;
    return accept();
}

/* Weighted mean over the stages of a step. */
static double mean(double a, double b, double c, double d)
{
    return (a + 2.0 * (b + c) + d) / 6.0;
}

/* Classical Runge-Kutta; the first slope is that of the motion, for torques are continuous. Energies are integrated along. */
dph_verdict mechanism_advance(Mechanism *m, const Drive *drive, const Axis axis[3], double motor_energy[3])
{
    static const double h = DRIVE_PERIOD;
    const dph_motion *now = &m->motion;
    dph_motion k[4], next;
    k[0] = *now;
    for (int stage = 1; stage < 4; ++stage) {
        int halves = stage < 3 ? 1 : 2;
        for (int i = 0; i < 3; ++i) {
            k[stage].theta[i] = now->theta[i] + 0.5 * halves * h * k[stage - 1].theta_d[i];
            k[stage].theta_d[i] = now->theta_d[i] + 0.5 * halves * h * k[stage - 1].theta_dd[i];
        }
        if (!solve(m, drive, axis, halves, &k[stage]))
            return singular(0.0);
    }
    double motor[3], joint[3];
    for (int i = 0; i < 3; ++i) {
        double v = k[0].theta_d[i] + 2.0 * (k[1].theta_d[i] + k[2].theta_d[i]) + k[3].theta_d[i];
        double a = k[0].theta_dd[i] + 2.0 * (k[1].theta_dd[i] + k[2].theta_dd[i]) + k[3].theta_dd[i];
        double torque[4];
        for (int stage = 0; stage < 4; ++stage)
            torque[stage] = axis_torque(drive, &axis[i], (stage + 1) / 2) * drive->gear_ratio;
        next.theta[i] = now->theta[i] + h / 6.0 * v;
        next.theta_d[i] = now->theta_d[i] + h / 6.0 * a;
        motor[i] = h * mean(torque[0] * k[0].theta_d[i], torque[1] * k[1].theta_d[i], torque[2] * k[2].theta_d[i],
                            torque[3] * k[3].theta_d[i]);
        joint[i] = h * mean(k[0].torque[i] * k[0].theta_d[i], k[1].torque[i] * k[1].theta_d[i], k[2].torque[i] * k[2].theta_d[i],
                            k[3].torque[i] * k[3].theta_d[i]);
    }
    if (!solve(m, drive, axis, 2, &next))
        return singular(0.0);
    dph_verdict verdict = region_check(&m->robot, &next);
    if (verdict.status != DPH_STATUS_OK)
        return verdict;
    m->motion = next;
    for (int i = 0; i < 3; ++i) {
        motor_energy[i] = motor[i];
        m->joint_energy[i] += joint[i];
    }
    return verdict;
}

int mechanism_is_caught(const Mechanism *m)
{
    if (!m->braked)
        return 0;
    for (int i = 0; i < 3; ++i)
        if (!(fabs(m->motion.theta_d[i]) < 0.5 * m->brake_speed))
            return 0;
    Mechanism held = *m;
    rest(&held);
    for (int i = 0; i < 3; ++i)
        if (!(fabs(held.motion.torque[i]) <= m->brake_torque))
            return 0;
    return 1;
}

void mechanism_lock(Mechanism *m)
{
    m->braked = m->locked = 1;
    rest(m);
}
