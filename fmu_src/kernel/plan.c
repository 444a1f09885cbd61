/* A plan: the task checked, a law of motion, one clock aligned to the 1 ms grid, and what the robot makes of it. */
#include <limits.h>
#include <math.h>
#include <string.h>

#include "delta_arms.h"
#include "laws.h"
#include "path.h"

/* Longest motion and longest dwell [s]; their milliseconds are far inside an int. */
static const double longest = 3600.0;

/* Heights that differ by less are level: a thousand times the rounding error of metres written as millimetres. */
static const double level_tolerance = 1e-9;

/* What a Delta robot can be asked for: far beyond any, and within it nothing overflows, and no phase is lost in the rounding of the clock. */
static const double greatest_length = 100.0, least_length = 1e-7;
static const double greatest_speed = 1e3, least_speed = 1e-6;
static const double greatest_payload = 1e6;

/* Accept a value in [least, most]; nothing else, no NaN either. */
static dph_verdict within(double value, double least, double most)
{
    if (value >= least && value <= most)
        return dph_accept();
    return dph_refuse(DPH_STATUS_INVALID_VALUE, DPH_PHASE_IDLE, 0, value > most ? most : least, value);
}

/* No lift at all is a side without a corner, which has no place in a superposition. */
static double least_lift(const dph_task *task, int which)
{
    return task->lift[which] == 0.0 && task->law != DPH_LAW_COMPARISON ? 0.0 : least_length;
}

static dph_verdict task_check(const dph_task *task)
{
    const double checks[][3] = {
        /* value, least, most */
        {task->pick[0], -greatest_length, greatest_length},
        {task->pick[1], -greatest_length, greatest_length},
        {task->pick[2], -greatest_length, greatest_length},
        {task->place[0], -greatest_length, greatest_length},
        {task->place[1], -greatest_length, greatest_length},
        {task->place[2], -greatest_length, greatest_length},
        {task->lift[0], least_lift(task, 0), greatest_length},
        {task->lift[1], least_lift(task, 1), greatest_length},
        {task->corner_deviation[0], least_length, greatest_length},
        {task->corner_deviation[1], least_length, greatest_length},
        {task->corner_entry_speed, least_speed, greatest_speed},
        {task->corner_mid_speed, least_speed, greatest_speed},
        {task->traverse_speed, least_speed, greatest_speed},
        {task->dwell, 0.0, longest},
        {task->payload, 0.0, greatest_payload},
        {task->overlap, 0.0, 1.0},
    };
    for (size_t i = 0; i < sizeof checks / sizeof *checks; ++i) {
        dph_verdict verdict = within(checks[i][0], checks[i][1], checks[i][2]);
        if (verdict.status != DPH_STATUS_OK)
            return verdict;
    }

    double begin = task->pick[2] + task->lift[0], end = task->place[2] + task->lift[1];
    if (!(fabs(begin - end) <= level_tolerance))
        return dph_refuse(DPH_STATUS_NOT_LEVEL, DPH_PHASE_TRAVERSE, 0, begin, end);
    return dph_accept();
}

/* A time [s] of up to `longest`, rounded up to whole milliseconds. One that is a whole number but for rounding takes no more: its own
 * rounding and that of the product are 2^-53 of 3.6e6 ms each, less than 1e-9 ms together. */
static int milliseconds(double time)
{
    return (int)ceil(1e3 * time - 1e-9);
}

/* One speed factor for the whole motion: nothing is floored phase by phase. */
static void align(dph_plan *plan)
{
    int duration_ms = milliseconds(plan->nominal_duration);
    plan->duration_ms = duration_ms > 1 ? duration_ms : 1;
    plan->dwell_ms = milliseconds(plan->task.dwell);
    plan->duration = plan->duration_ms / 1e3;
    plan->speed_factor = fmin(plan->nominal_duration / plan->duration, 1.0);
}

static void planar_at(const dph_plan *plan, int piece, double nominal_time, dph_planar *motion)
{
    switch (plan->task.law) {
    case DPH_LAW_PAPER:
    case DPH_LAW_PAPER_LIMITED:
        dph_paper_at(plan, piece, nominal_time, motion);
        break;
    case DPH_LAW_COMPARISON:
        dph_superposition_at(plan, piece, nominal_time, motion);
        break;
    default: /* DPH_LAW_TIME_OPTIMAL */
        dph_time_optimal_at(plan, piece, nominal_time, motion);
        break;
    }
}

static double distance2(const double a[3], const double b[3], double height)
{
    double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2] - height;
    return x * x + y * y + z * z;
}

/* Distance to the vertex of the nearer corner. */
static double vertex_distance(const dph_task *task, const double point[3])
{
    double pick = distance2(point, task->pick, task->lift[0]), place = distance2(point, task->place, task->lift[1]);
    return sqrt(pick < place ? pick : place);
}

/* A vector of the motion's plane, whose horizontal direction is (c, s). */
static inline void in_space(double horizontal, double vertical, double c, double s, double vector[3])
{
    vector[0] = horizontal * c;
    vector[1] = horizontal * s;
    vector[2] = vertical;
}

/* How much of a setpoint is asked for: joint position, velocity and acceleration, or all of it. */
typedef enum Extent { JOINTS, WHOLE } Extent;

/* The tcp part of a setpoint. */
static inline void tcp_at(const dph_plan *plan, int piece, double time, Extent extent, dph_setpoint *setpoint)
{
    double factor = plan->speed_factor, nominal = factor * time;
    double begin = plan->boundary[piece], end = plan->boundary[piece + 1];
    dph_planar motion;
    planar_at(plan, piece, nominal < begin ? begin : nominal > end ? end : nominal, &motion);

    const double *origin = motion.side == 0 ? plan->task.pick : plan->task.place;
    double c = plan->direction[0], s = plan->direction[1], factor2 = factor * factor, factor3 = factor2 * factor;
    setpoint->tcp_position[0] = origin[0] + motion.d[0][0] * c;
    setpoint->tcp_position[1] = origin[1] + motion.d[0][0] * s;
    setpoint->tcp_position[2] = origin[2] + motion.d[0][1];
    in_space(factor * motion.d[1][0], factor * motion.d[1][1], c, s, setpoint->tcp_velocity);
    in_space(factor2 * motion.d[2][0], factor2 * motion.d[2][1], c, s, setpoint->tcp_acceleration);
    if (extent == JOINTS)
        return;
    in_space(factor3 * motion.d[3][0], factor3 * motion.d[3][1], c, s, setpoint->tcp_jerk);
    setpoint->arc_length = motion.arc_length;
    setpoint->length = plan->length;
    setpoint->vertex_distance = vertex_distance(&plan->task, setpoint->tcp_position);
    setpoint->phase = plan->phase[piece];
}

/* The joint part of a setpoint from its tcp part. */
static inline dph_verdict joints_at(const dph_robot *robot, double payload, Extent extent, dph_setpoint *setpoint)
{
    dph_pose pose;
    dph_verdict verdict = dph_pose_at(robot, setpoint->tcp_position, &pose);
    if (verdict.status != DPH_STATUS_OK)
        return verdict;
    dph_pose_angles(&pose, setpoint->joint_position);
    if (extent == JOINTS) {
        dph_pose_acceleration(&pose, setpoint->tcp_velocity, setpoint->tcp_acceleration, setpoint->joint_velocity,
                              setpoint->joint_acceleration);
        return verdict;
    }
    dph_motion motion = {.force = {0.0}};
    dph_pose_motion(&pose, setpoint->tcp_velocity, setpoint->tcp_acceleration, setpoint->tcp_jerk, motion.theta_d, motion.theta_dd,
                    setpoint->joint_jerk);
    memcpy(motion.point_dd, setpoint->tcp_acceleration, sizeof motion.point_dd);
    dph_pose_dynamics(robot, &pose, payload, &motion);
    memcpy(setpoint->joint_velocity, motion.theta_d, sizeof motion.theta_d);
    memcpy(setpoint->joint_acceleration, motion.theta_dd, sizeof motion.theta_dd);
    memcpy(setpoint->joint_torque, motion.torque, sizeof motion.torque);
    return verdict;
}

static dph_verdict begin(const dph_robot *robot, const dph_task *task, dph_progress *progress, dph_workspace *workspace, dph_plan *plan)
{
    dph_verdict verdict = dph_robot_check(robot);
    if (verdict.status != DPH_STATUS_OK)
        return verdict;
    verdict = task_check(task);
    if (verdict.status != DPH_STATUS_OK)
        return verdict;

    memset(plan, 0, sizeof *plan);
    plan->robot = *robot;
    plan->task = *task;
    double x = task->place[0] - task->pick[0], y = task->place[1] - task->pick[1];
    plan->traverse = hypot(x, y);
    plan->direction[0] = plan->traverse > 0.0 ? x / plan->traverse : 1.0;
    plan->direction[1] = plan->traverse > 0.0 ? y / plan->traverse : 0.0;

    memset(progress, 0, sizeof *progress);
    if (task->law == DPH_LAW_TIME_OPTIMAL)
        dph_time_optimal_begin(workspace);
    return dph_unfinished();
}

static dph_verdict law_continue(dph_progress *progress, dph_workspace *workspace, dph_plan *plan, int *units)
{
    switch (plan->task.law) {
    case DPH_LAW_PAPER:
        *units -= DPH_CORNER_UNITS;
        return dph_paper_make(plan);
    case DPH_LAW_COMPARISON:
        *units -= DPH_STROKES_UNITS;
        return dph_superposition_make(plan);
    case DPH_LAW_PAPER_LIMITED:
        return dph_paper_limited_continue(&progress->search, plan, units);
    case DPH_LAW_TIME_OPTIMAL:
        return dph_time_optimal_continue(workspace, plan, units);
    }
    return dph_refuse(DPH_STATUS_INVALID_VALUE, DPH_PHASE_IDLE, 0, 0.0, plan->task.law);
}

/* The law, the clock, and whether the robot can follow; the laws within limits have asked that before their search. */
static dph_verdict proceed(dph_progress *progress, dph_workspace *workspace, dph_plan *plan, int units)
{
    if (!progress->has_law) {
        dph_verdict verdict = law_continue(progress, workspace, plan, &units);
        if (verdict.status != DPH_STATUS_OK)
            return verdict;
        plan->nominal_duration = plan->boundary[plan->pieces];
        plan->length = plan->arc_boundary[plan->pieces];
        if (!(plan->nominal_duration <= longest))
            return dph_refuse(DPH_STATUS_TOO_SLOW, DPH_PHASE_IDLE, 0, plan->nominal_duration, longest);
        align(plan);
        progress->has_law = 1;
    }
    if (plan->task.law == DPH_LAW_PAPER_LIMITED || plan->task.law == DPH_LAW_TIME_OPTIMAL)
        return dph_accept();
    return dph_path_check(plan, &progress->cursor, &units);
}

dph_verdict dph_plan_begin(const dph_robot *robot, const dph_task *task, dph_workspace *workspace, dph_plan *plan)
{
    return begin(robot, task, &workspace->progress, workspace, plan);
}

dph_verdict dph_plan_continue(dph_workspace *workspace, dph_plan *plan, int units)
{
    return proceed(&workspace->progress, workspace, plan, units);
}

dph_verdict dph_plan_make(const dph_robot *robot, const dph_task *task, dph_workspace *workspace, dph_plan *plan)
{
    dph_progress progress; /* the workspace need not be there */
    dph_verdict verdict = begin(robot, task, &progress, workspace, plan);
    while (verdict.status == DPH_STATUS_PLANNING)
        verdict = proceed(&progress, workspace, plan, INT_MAX);
    return verdict;
}

static inline void sample_piece(const dph_plan *plan, int piece, double time, Extent extent, dph_setpoint *setpoint)
{
    tcp_at(plan, piece, time, extent, setpoint);
    (void)joints_at(&plan->robot, plan->task.payload, extent, setpoint); /* cannot fail: the path is checked */
}

void dph_plan_sample_piece(const dph_plan *plan, int piece, double time, dph_setpoint *setpoint)
{
    sample_piece(plan, piece, time, WHOLE, setpoint);
}

static inline void sample(const dph_plan *plan, double time, Extent extent, dph_setpoint *setpoint)
{
    if (time >= 0.0 && time < plan->duration) {
        double nominal = plan->speed_factor * time, end = plan->boundary[plan->pieces];
        int piece = 0;
        /* Phases that this path does not have are passed over, also at the end. */
        while (plan->boundary[piece + 1] < end && nominal >= plan->boundary[piece + 1])
            ++piece;
        sample_piece(plan, piece, time, extent, setpoint);
        return;
    }
    int arrived = time >= plan->duration;
    (void)dph_rest(&plan->robot, arrived ? plan->task.place : plan->task.pick, plan->task.payload, setpoint);
    if (time < 0.0 && time >= -plan->dwell_ms / 1e3)
        setpoint->phase = DPH_PHASE_DWELL;
    setpoint->arc_length = arrived ? plan->length : 0.0;
    setpoint->length = plan->length;
    setpoint->vertex_distance = vertex_distance(&plan->task, setpoint->tcp_position);
}

void dph_plan_sample(const dph_plan *plan, double time, dph_setpoint *setpoint)
{
    sample(plan, time, WHOLE, setpoint);
}

void dph_plan_sample_at_rate(const dph_plan *plan, double time, const double rate[3], dph_setpoint *setpoint)
{
    dph_plan_sample(plan, time, setpoint);
    double r = rate[0];
    if (r == 1.0 && rate[1] == 0.0 && rate[2] == 0.0)
        return;
    for (int i = 0; i < 3; ++i) {
        double v = setpoint->tcp_velocity[i], a = setpoint->tcp_acceleration[i], j = setpoint->tcp_jerk[i];
        setpoint->tcp_velocity[i] = v * r;
        setpoint->tcp_acceleration[i] = a * r * r + v * rate[1];
        setpoint->tcp_jerk[i] = j * r * r * r + 3.0 * a * r * rate[1] + v * rate[2];
    }
    (void)joints_at(&plan->robot, plan->task.payload, WHOLE, setpoint); /* cannot fail: the path is checked */
}

void dph_plan_sample_array(const dph_plan *plan, int n, const double *time, dph_setpoint *setpoint)
{
    for (int i = 0; i < n; ++i)
        sample(plan, time[i], WHOLE, &setpoint[i]);
}

void dph_plan_sample_joints(const dph_plan *plan, int n, const double *time, double *position, double *velocity, double *acceleration)
{
    for (int i = 0; i < n; ++i) {
        dph_setpoint setpoint;
        sample(plan, time[i], JOINTS, &setpoint);
        memcpy(&position[3 * i], setpoint.joint_position, sizeof setpoint.joint_position);
        memcpy(&velocity[3 * i], setpoint.joint_velocity, sizeof setpoint.joint_velocity);
        memcpy(&acceleration[3 * i], setpoint.joint_acceleration, sizeof setpoint.joint_acceleration);
    }
}

dph_verdict dph_rest(const dph_robot *robot, const double point[3], double payload, dph_setpoint *setpoint)
{
    dph_setpoint rest;
    memset(&rest, 0, sizeof rest);
    memcpy(rest.tcp_position, point, sizeof rest.tcp_position);
    dph_verdict verdict = joints_at(robot, payload, WHOLE, &rest);
    if (verdict.status == DPH_STATUS_OK)
        *setpoint = rest;
    return verdict;
}
