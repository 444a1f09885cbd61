/* The moving robot: RK4 on the reduced equations of motion, brakes, and the region in which the equations hold. */
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

/* Everything that follows from theta, theta_d and the time since the last sample. */
static int solve(const Mechanism *m, const Drive *drive, const Axis axis[3], int halves, dph_motion *motion)
{
    for (int i = 0; i < 3; ++i) {
        motion->torque[i] = drive_joint_torque(drive, axis_torque(drive, &axis[i], halves), motion->theta_d[i]);
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
    dph_inverse_dynamics(&m->robot, m->payload, &m->motion);
}

dph_verdict mechanism_start(Mechanism *m, const Drive *drive, const double theta[3], const double point[3])
{
    memcpy(m->motion.theta, theta, sizeof m->motion.theta);
    memcpy(m->motion.point, point, sizeof m->motion.point);
    m->braked = m->locked = 0;
    /* The brake's slope over the least inertia a joint can have is 1 / DRIVE_PERIOD: as steep as RK4 takes in its stride. */
    m->brake_torque = drive->gear_ratio * motor_brake_torque;
    m->brake_speed = m->brake_torque * DRIVE_PERIOD / (m->robot.upper_arm_inertia + m->robot.drive_inertia);
    rest(m);
    return region_check(&m->robot, &m->motion);
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

/* Classical Runge-Kutta; the first slope is that of the motion, for torques are continuous. */
dph_verdict mechanism_advance(Mechanism *m, const Drive *drive, const Axis axis[3])
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
    for (int i = 0; i < 3; ++i) {
        double v = k[0].theta_d[i] + 2.0 * (k[1].theta_d[i] + k[2].theta_d[i]) + k[3].theta_d[i];
        double a = k[0].theta_dd[i] + 2.0 * (k[1].theta_dd[i] + k[2].theta_dd[i]) + k[3].theta_dd[i];
        next.theta[i] = now->theta[i] + h / 6.0 * v;
        next.theta_d[i] = now->theta_d[i] + h / 6.0 * a;
    }
    if (!solve(m, drive, axis, 2, &next))
        return singular(0.0);
    dph_verdict verdict = region_check(&m->robot, &next);
    if (verdict.status == DPH_STATUS_OK)
        m->motion = next;
    return verdict;
}

int mechanism_is_caught(const Mechanism *m)
{
    for (int i = 0; i < 3; ++i)
        if (!(fabs(m->motion.theta_d[i]) < 0.5 * m->brake_speed))
            return 0;
    return m->braked;
}

void mechanism_lock(Mechanism *m)
{
    m->braked = m->locked = 1;
    rest(m);
}
