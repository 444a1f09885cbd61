/* The path of a PPO: up, around a quintic PH corner, across, around another one, down. By arc length, and by the parameter x of the
 * time-optimal law. The place side is the mirror image of a pick side: it is measured from the place point. */
#include "path.h"

#include <math.h>
#include <string.h>

#include "corner_law.h"
#include "delta_arms.h"
#include "laws.h"

const dph_phase dph_segment_phase[SEGMENTS] = {DPH_PHASE_LIFT,       DPH_PHASE_PICK_CORNER,  DPH_PHASE_ACCELERATE,
                                               DPH_PHASE_DECELERATE, DPH_PHASE_PLACE_CORNER, DPH_PHASE_LOWER};

dph_verdict dph_path_make(dph_plan *plan)
{
    const dph_task *task = &plan->task;
    for (int which = 0; which < 2; ++which) {
        dph_side *side = &plan->side[which];
        dph_corner *corner = &side->corner.corner;
        dph_corner_from_deviation(task->corner_deviation[which], corner);
        /* A lift is left that the clock can tell from none. */
        if (!(corner->leg <= (1.0 - 1e-9) * task->lift[which]))
            return dph_refuse(DPH_STATUS_LIFT_TOO_LOW, which == 0 ? DPH_PHASE_PICK_CORNER : DPH_PHASE_PLACE_CORNER, 0,
                              corner->deviation, task->lift[which] * (corner->deviation / corner->leg));
        side->lift_length = task->lift[which] - corner->leg;
        plan->corner_deviation[which] = task->corner_deviation[which];
    }
    double legs = plan->side[0].corner.corner.leg + plan->side[1].corner.corner.leg;
    if (!(legs <= plan->traverse))
        return dph_refuse(DPH_STATUS_TRAVERSE_TOO_SHORT, DPH_PHASE_IDLE, 0, legs, plan->traverse);

    double length[SEGMENTS];
    for (int which = 0; which < 2; ++which) {
        dph_side *side = &plan->side[which];
        side->cruise_length = 0.5 * (plan->traverse - legs);
        length[which == 0 ? 0 : 5] = side->lift_length;
        length[which == 0 ? 1 : 4] = side->corner.corner.length;
        length[which == 0 ? 2 : 3] = side->cruise_length;
    }
    for (int segment = 0; segment < SEGMENTS; ++segment)
        plan->segment_arc[segment + 1] = plan->segment_arc[segment] + length[segment];
    plan->length = plan->segment_arc[SEGMENTS];
    return dph_accept();
}

/* Arc lengths from the nearer end at which segments 0, 1, 2 of a side end. */
static double segment_end(const dph_side *side, int part)
{
    return side->lift_length + (part > 0 ? side->corner.corner.length : 0.0) + (part > 1 ? side->cruise_length : 0.0);
}

int dph_path_segment(const dph_plan *plan, int segment, double length)
{
    const dph_side *side = &plan->side[segment < 3 ? 0 : 1];
    int part = segment < 3 ? segment : 5 - segment;
    /* One-sided at a segment's end, but for rounding. */
    double rounding = 1e-12 * plan->length;
    while (part < 2 && length > segment_end(side, part) + rounding)
        ++part;
    while (part > 0 && length < segment_end(side, part - 1) - rounding)
        --part;
    return segment < 3 ? part : 5 - part;
}

void dph_path_at(const dph_plan *plan, int segment, double length, double d[4][2])
{
    static const double unit_speed[3] = {1.0, 0.0, 0.0};
    const dph_side *side = &plan->side[segment < 3 ? 0 : 1];
    const dph_corner *corner = &side->corner.corner;
    double on_corner, past = length - side->lift_length;
    memset(d, 0, 4 * sizeof *d);
    switch (segment < 3 ? segment : 5 - segment) {
    case 0:
        d[0][1] = length;
        d[1][1] = 1.0;
        break;
    case 1:
        dph_corner_motion(corner, dph_corner_gamma(corner, past), unit_speed, d, &on_corner);
        d[0][1] += side->lift_length;
        break;
    default:
        d[0][0] = corner->leg + (past - corner->length);
        d[0][1] = side->lift_length + corner->leg;
        d[1][0] = 1.0;
        break;
    }
    /* The place side is run the other way and mirrored: odd derivatives change sign once, horizontal ones once more. */
    if (segment >= 3)
        for (int order = 0; order < 4; ++order)
            d[order][order % 2 == 0 ? 0 : 1] *= -1.0;
}

void dph_parameter_at(double x, double y[4])
{
    double r = 1.0 - x;
    y[0] = x * x * x * (10.0 + x * (6.0 * x - 15.0));
    y[1] = 30.0 * x * x * r * r;
    y[2] = 60.0 * x * r * (1.0 - 2.0 * x);
    y[3] = 60.0 * (1.0 - 6.0 * x * r);
}

double dph_parameter_of(double share)
{
    double low = 0.0, high = 1.0, x = 0.5, y[4];
    /* Newton's method within a shrinking bracket; y' vanishes at both ends. */
    for (int i = 0; i < 100 && high - low > 1e-16; ++i) {
        dph_parameter_at(x, y);
        if (y[0] > share)
            high = x;
        else
            low = x;
        double next = x - (y[0] - share) / y[1];
        next = next >= low && next <= high ? next : 0.5 * (low + high);
        if (next == x)
            break;
        x = next;
    }
    return x;
}

void dph_path_by_parameter(const dph_plan *plan, int segment, double x, double d[4][2], double *ds, double *arc_length)
{
    /* From the nearer end, so that both ends are exact. */
    double y[4], by_arc[4][2];
    int place = segment >= 3;
    dph_parameter_at(place ? 1.0 - x : x, y);
    double length = plan->length * y[0];
    segment = dph_path_segment(plan, segment, length);
    dph_path_at(plan, segment, length, by_arc);

    double s1 = plan->length * y[1], s2 = plan->length * y[2] * (place ? -1.0 : 1.0), s3 = plan->length * y[3];
    for (int i = 0; i < 2; ++i) {
        d[0][i] = by_arc[0][i];
        d[1][i] = by_arc[1][i] * s1;
        d[2][i] = by_arc[2][i] * s1 * s1 + by_arc[1][i] * s2;
        d[3][i] = by_arc[3][i] * s1 * s1 * s1 + 3.0 * by_arc[2][i] * s1 * s2 + by_arc[1][i] * s3;
    }
    *ds = s1;
    *arc_length = place ? plan->length - length : length;
}

/* Least dexterity on a path; at the sources' default robot the paper's path keeps above 0.7. */
static const double least_dexterity = 0.1;

dph_verdict dph_pose_check(const dph_robot *robot, const double point[3], dph_phase phase)
{
    dph_pose pose;
    dph_verdict verdict = dph_pose_at(robot, point, &pose);
    verdict.phase = phase;
    if (verdict.status != DPH_STATUS_OK)
        return verdict;
    for (int i = 0; i < 3; ++i) {
        double theta = atan2(pose.direction[i][1], pose.direction[i][0]);
        if (theta < robot->joint_position_min)
            return dph_refuse(DPH_STATUS_JOINT_RANGE, phase, i + 1, theta, robot->joint_position_min);
        if (theta > robot->joint_position_max)
            return dph_refuse(DPH_STATUS_JOINT_RANGE, phase, i + 1, theta, robot->joint_position_max);
    }
    double dexterity = dph_pose_dexterity(robot, &pose);
    if (!(dexterity >= least_dexterity))
        return dph_refuse(DPH_STATUS_SINGULAR, phase, 0, least_dexterity, dexterity);
    return verdict;
}

/* Points at most 2.5 mm apart. With a dexterity of at least 0.1 at its ends no such interval can hide a singularity: 1.25 mm turn a joint
 * by at most 1.25 mm / (0.1 * upper arm length), which changes the dexterity by less than it is. */
dph_verdict dph_path_check(const dph_plan *plan)
{
    static const double spacing = 2.5e-3;
    for (int segment = 0; segment < SEGMENTS; ++segment) {
        int place = segment >= 3;
        const double *origin = place ? plan->task.place : plan->task.pick;
        double begin = plan->segment_arc[segment], length = plan->segment_arc[segment + 1] - begin;
        int intervals = 4 + (int)(length / spacing);
        for (int i = 0; i <= intervals; ++i) {
            double at = begin + length * i / intervals, d[4][2], point[3];
            dph_path_at(plan, segment, place ? plan->length - at : at, d);
            for (int k = 0; k < 2; ++k)
                point[k] = origin[k] + d[0][0] * plan->direction[k];
            point[2] = origin[2] + d[0][1];
            dph_verdict verdict = dph_pose_check(&plan->robot, point, dph_segment_phase[segment]);
            if (verdict.status != DPH_STATUS_OK)
                return verdict;
        }
    }
    return dph_accept();
}
