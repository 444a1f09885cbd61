/* What the limits say along a path: joint motion and torque by the path parameter, and the rows of the solver. */
#include <math.h>
#include <string.h>

#include "delta_arms.h"
#include "laws.h"
#include "time_optimal.h"

/* A limit of this size or more is none. */
static const double none = 1e30;

/* A limit below would make every PPO take longer than is allowed; its powers are still far from underflow. */
static const double least = 1e-12;

/* Greatest dx/dt [1/s], where no other limit holds the ends: no PPO is done in less than 5 ms. A jerk limit J on every joint holds them at some
 * cbrt(J / 70): then it is far above that, and on the same clock. */
static const double fastest = 200.0, fastest_by_jerk = 3.2;

static dph_verdict invert(double limit, double *inverse, int *finite)
{
    if (!(limit >= least))
        return dph_refuse(DPH_STATUS_INVALID_VALUE, DPH_PHASE_IDLE, 0, least, limit);
    *inverse = limit < none ? 1.0 / limit : 0.0;
    *finite |= limit < none;
    return dph_accept();
}

/* Which rows there are. Returns OK, INVALID_VALUE or NO_LIMIT. */
static dph_verdict limits_make(const dph_limits *limits, dph_bounds *bounds)
{
    int has_velocity = 0, has_acceleration = 0, has_tcp = 0;
    memset(bounds, 0, sizeof *bounds);
    for (int i = 0; i < 3; ++i) {
        const struct {
            double limit;
            double *inverse;
            int *has;
        } each[] = {{limits->joint_velocity[i], &bounds->velocity[i], &has_velocity},
                    {limits->joint_acceleration[i], &bounds->acceleration[i], &has_acceleration},
                    {limits->joint_jerk[i], &bounds->jerk[i], &bounds->has_jerk},
                    {limits->joint_torque[i], &bounds->torque[i], &bounds->has_torque},
                    {limits->tcp_speed, &bounds->tcp_speed, &has_tcp}};
        for (size_t k = 0; k < sizeof each / sizeof *each; ++k) {
            dph_verdict verdict = invert(each[k].limit, each[k].inverse, each[k].has);
            if (verdict.status != DPH_STATUS_OK)
                return verdict;
        }
    }
    if (!has_velocity && !has_acceleration && !has_tcp && !bounds->has_jerk && !bounds->has_torque)
        return dph_refuse(DPH_STATUS_NO_LIMIT, DPH_PHASE_IDLE, 0, 1.0, 0.0);
    double jerk = fmin(bounds->jerk[0], fmin(bounds->jerk[1], bounds->jerk[2]));
    double greatest = jerk > 0.0 ? fmin(fastest_by_jerk / cbrt(jerk), fastest) : fastest;
    bounds->least_inverse_cap = 1.0 / (greatest * greatest);
    return dph_accept();
}

/* Torque of a motion: joint velocities, joint accelerations and tcp acceleration, the latter two times `factor`. */
static void torque_of(const dph_plan *plan, const dph_pose *pose, const double q_d[3], double factor, const double q_dd[3],
                      const double p_dd[3], double torque[3])
{
    dph_motion motion = {.force = {0.0}};
    for (int i = 0; i < 3; ++i) {
        motion.theta_d[i] = q_d[i];
        motion.theta_dd[i] = factor * q_dd[i];
        motion.point_dd[i] = factor * p_dd[i];
    }
    dph_pose_dynamics(&plan->robot, pose, plan->task.payload, &motion);
    memcpy(torque, motion.torque, sizeof motion.torque);
}

void dph_path_point_at(const dph_plan *plan, const dph_bounds *bounds, int segment, double x, dph_path_point *point)
{
    double planar[4][2], tcp[4][3], arc_length;
    dph_path_by_parameter(plan, segment, x, planar, &point->ds, &arc_length);
    const double *origin = segment >= 3 ? plan->task.place : plan->task.pick;
    for (int order = 0; order < 4; ++order) {
        tcp[order][0] = planar[order][0] * plan->direction[0];
        tcp[order][1] = planar[order][0] * plan->direction[1];
        tcp[order][2] = planar[order][1];
    }
    for (int i = 0; i < 3; ++i)
        tcp[0][i] += origin[i];

    dph_pose pose;
    (void)dph_pose_at(&plan->robot, tcp[0], &pose); /* cannot fail: dph_path_check */
    dph_pose_motion(&pose, tcp[1], tcp[2], tcp[3], point->q[0], point->q[1], point->q[2]);
    if (bounds->has_torque) {
        /* By b: q'' = d2q/dx2 b, and so on; by b': d2q/dt2 = q' b'/2. */
        static const double rest[3] = {0.0, 0.0, 0.0};
        torque_of(plan, &pose, rest, 0.0, rest, rest, point->gravity);
        torque_of(plan, &pose, point->q[0], 1.0, point->q[1], tcp[2], point->dynamic[0]);
        torque_of(plan, &pose, rest, 0.5, point->q[0], tcp[1], point->dynamic[1]);
        for (int i = 0; i < 3; ++i) {
            point->dynamic[0][i] -= point->gravity[i];
            point->dynamic[1][i] -= point->gravity[i];
        }
    }
}

/* Can gravity be held everywhere on the path? OK, or LIMIT_EXCEEDED with phase and joint. */
static dph_verdict gravity_check(const dph_plan *plan, const dph_bounds *bounds)
{
    /* Something must be left to move with. */
    static const double share = 0.99;
    enum { POINTS = 8 };
    for (int segment = 0; bounds->has_torque && segment < SEGMENTS; ++segment) {
        double begin = plan->segment_arc[segment], length = plan->segment_arc[segment + 1] - begin;
        for (int k = 0; k <= POINTS; ++k) {
            dph_path_point point;
            double arc = begin + length * k / POINTS;
            dph_path_point_at(plan, bounds, segment, dph_parameter_of(arc / plan->length), &point);
            for (int i = 0; i < 3; ++i)
                if (!(fabs(point.gravity[i]) * bounds->torque[i] <= share))
                    return dph_refuse(DPH_STATUS_LIMIT_EXCEEDED, dph_segment_phase[segment], i + 1, fabs(point.gravity[i]),
                                      1.0 / bounds->torque[i]);
        }
    }
    return dph_accept();
}

/* Work [units]. */
enum { MAKE_UNITS = 30, GRAVITY_UNITS = 90 };

dph_verdict dph_path_begin(dph_plan *plan, dph_bounds *bounds, dph_laying *laying, int *units)
{
    *units -= MAKE_UNITS;
    dph_verdict verdict = dph_path_make(plan);
    if (verdict.status == DPH_STATUS_OK)
        verdict = limits_make(&plan->task.limits, bounds);
    laying->is_laid = 1;
    return verdict;
}

dph_verdict dph_path_lay(dph_plan *plan, dph_bounds *bounds, dph_laying *laying, int *units)
{
    dph_verdict verdict = laying->is_laid ? dph_accept() : dph_path_begin(plan, bounds, laying, units);
    if (verdict.status == DPH_STATUS_OK)
        verdict = dph_path_check(plan, &laying->cursor, units);
    if (verdict.status == DPH_STATUS_OK) {
        *units -= bounds->has_torque ? GRAVITY_UNITS : 0;
        verdict = gravity_check(plan, bounds);
    }
    return verdict;
}

double dph_inverse_cap(const dph_bounds *bounds, const dph_path_point *point)
{
    double speed = point->ds * bounds->tcp_speed, cap = speed * speed, floor = bounds->least_inverse_cap;
    for (int i = 0; i < 3; ++i) {
        double v = point->q[0][i] * bounds->velocity[i];
        cap = v * v > cap ? v * v : cap;
    }
    return cap > floor ? cap : floor;
}

void dph_rows_at(const dph_bounds *bounds, const dph_path_point *point, double c[][3], double offset[], int count[2])
{
    int n = 0;
    for (int i = 0; i < 3; ++i) {
        if (bounds->acceleration[i] > 0.0) {
            c[n][0] = point->q[1][i] * bounds->acceleration[i];
            c[n][1] = 0.5 * point->q[0][i] * bounds->acceleration[i];
            c[n][2] = 0.0;
            offset[n++] = 0.0;
        }
        if (bounds->torque[i] > 0.0) {
            c[n][0] = point->dynamic[0][i] * bounds->torque[i];
            c[n][1] = point->dynamic[1][i] * bounds->torque[i];
            c[n][2] = 0.0;
            offset[n++] = point->gravity[i] * bounds->torque[i];
        }
    }
    count[0] = n;
    for (int i = 0; i < 3; ++i) {
        if (bounds->jerk[i] > 0.0) {
            c[n][0] = point->q[2][i] * bounds->jerk[i];
            c[n][1] = 1.5 * point->q[1][i] * bounds->jerk[i];
            c[n][2] = 0.5 * point->q[0][i] * bounds->jerk[i];
            offset[n++] = 0.0;
        }
    }
    count[1] = n - count[0];
}
