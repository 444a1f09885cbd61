/* The paper's law, as fast as the limits allow: a search over its three speeds.
 *
 * All three speeds times f are the same motion on a clock f times as fast: velocity grows with f, acceleration and the dynamic part of
 * torque with f^2, jerk with f^3. What is searched is therefore the shape alone, two ratios of speeds; the greatest f of a shape follows
 * from its peaks. */
#include <math.h>

#include "laws.h"
#include "time_optimal.h"

/* Samples of a piece during the search. The peaks of the result are taken exactly. */
enum { SAMPLES = 16 };

/* Ratios searched, logarithms: V_N / V_B from 0.25 to 1.5, V_max / V_B from 0.5 to 8, on a grid, then by halving steps around its best. */
enum { GRID = 7, HALVINGS = 7 };
static const double shape_low[2] = {-1.3862943611198906, -0.6931471805599453};
static const double shape_high[2] = {0.4054651081081644, 2.0794415416798357};

/* Keeps rounding from making a peak exceed its limit. */
static const double below = 1.0 - 1e-9;

typedef struct Search {
    dph_plan *plan;
    dph_bounds bounds;
    double gravity; /* greatest share of a torque limit that holding still takes */
} Search;

static void keep_greatest(double value, double *greatest)
{
    if (!(value <= *greatest))
        *greatest = value;
}

/* Make the paper's plan with these speeds, on its nominal clock; its path is laid. */
static void plan_with(const Search *search, double corner_entry, double corner_mid, double traverse)
{
    dph_task *task = &search->plan->task;
    task->corner_entry_speed = corner_entry;
    task->corner_mid_speed = corner_mid;
    task->traverse_speed = traverse;
    dph_paper_move(search->plan);
    search->plan->speed_factor = 1.0;
}

static double duration(const Search *search)
{
    return search->plan->boundary[search->plan->pieces];
}

/* 1 / f^2 by the torque at one instant. */
static double torque_ratio(Search *search, const dph_setpoint *s)
{
    dph_setpoint rest;
    double greatest = 0.0;
    (void)dph_rest(&search->plan->robot, s->tcp_position, search->plan->task.payload, &rest);
    for (int i = 0; i < 3; ++i) {
        double still = rest.joint_torque[i] * search->bounds.torque[i];
        double moving = (s->joint_torque[i] - rest.joint_torque[i]) * search->bounds.torque[i];
        keep_greatest(moving > 0.0 ? moving / (1.0 - still) : -moving / (1.0 + still), &greatest);
        keep_greatest(fabs(still), &search->gravity);
    }
    return greatest;
}

/* Greatest f by samples of the present plan. */
static double factor_by_samples(Search *search)
{
    const dph_bounds *bounds = &search->bounds;
    double velocity = 0.0, acceleration = 0.0, jerk = 0.0;
    for (int piece = 0; piece < search->plan->pieces; ++piece) {
        double begin = search->plan->boundary[piece], step = (search->plan->boundary[piece + 1] - begin) / SAMPLES;
        if (!(step > 0.0))
            continue;
        for (int k = 0; k <= SAMPLES; ++k) {
            dph_setpoint s;
            dph_plan_sample_piece(search->plan, piece, begin + step * k, &s);
            for (int i = 0; i < 3; ++i) {
                keep_greatest(fabs(s.joint_velocity[i]) * bounds->velocity[i], &velocity);
                keep_greatest(fabs(s.joint_acceleration[i]) * bounds->acceleration[i], &acceleration);
                keep_greatest(fabs(s.joint_jerk[i]) * bounds->jerk[i], &jerk);
            }
            keep_greatest(hypot(hypot(s.tcp_velocity[0], s.tcp_velocity[1]), s.tcp_velocity[2]) * bounds->tcp_speed, &velocity);
            if (bounds->has_torque)
                keep_greatest(torque_ratio(search, &s), &acceleration);
        }
    }
    double slowest = velocity;
    keep_greatest(sqrt(acceleration), &slowest);
    keep_greatest(cbrt(jerk), &slowest);
    return 1.0 / slowest;
}

/* Greatest f by the exact peaks of the present plan, whose torque is near its limit. */
static double factor_by_peaks(const Search *search)
{
    const dph_bounds *bounds = &search->bounds;
    dph_peaks peaks;
    dph_plan_peaks(search->plan, &peaks);
    double slowest = peaks.tcp_speed * bounds->tcp_speed;
    for (int i = 0; i < 3; ++i) {
        keep_greatest(peaks.joint_velocity[i] * bounds->velocity[i], &slowest);
        keep_greatest(sqrt(peaks.joint_acceleration[i] * bounds->acceleration[i]), &slowest);
        keep_greatest(cbrt(peaks.joint_jerk[i] * bounds->jerk[i]), &slowest);
        /* The most cautious share of gravity in that peak: the greatest. */
        double torque = peaks.joint_torque[i] * bounds->torque[i];
        if (torque > 1.0)
            keep_greatest(sqrt((torque - search->gravity) / (1.0 - search->gravity)), &slowest);
    }
    return below / slowest;
}

/* Leave the plan with a shape, as fast as the samples allow. Returned: its duration [s]. */
static double try_shape(Search *search, const double shape[2])
{
    double mid = exp(shape[0]), traverse = exp(shape[1]);
    plan_with(search, 1.0, mid, traverse);
    double f = factor_by_samples(search);
    if (!(f > 0.0) || !isfinite(f))
        return HUGE_VAL;
    return duration(search) / f;
}

/* Make the plan of a shape as fast as its peaks allow, torque included. Returned: its duration [s]. */
static double settle(Search *search, const double shape[2])
{
    double f = 1.0, mid = exp(shape[0]), traverse = exp(shape[1]);
    plan_with(search, f, mid, traverse);
    f = factor_by_samples(search);
    plan_with(search, f, f * mid, f * traverse);
    f *= factor_by_peaks(search);
    plan_with(search, f, f * mid, f * traverse);
    return duration(search);
}

static void search_shape(Search *search, double best[2])
{
    double least = try_shape(search, best), step[2];
    for (int axis = 0; axis < 2; ++axis)
        step[axis] = (shape_high[axis] - shape_low[axis]) / (GRID - 1);
    for (int i = 0; i < GRID; ++i)
        for (int k = -1; k < GRID; ++k) {
            /* First without any change of speed on the traverse: where the corners leave next to nothing of it, nothing else will do. */
            double shape[2] = {shape_low[0] + step[0] * i, k < 0 ? 0.0 : shape_low[1] + step[1] * k}, found = try_shape(search, shape);
            if (found < least) {
                least = found;
                best[0] = shape[0];
                best[1] = shape[1];
            }
        }
    for (int halving = 0; halving < HALVINGS; ++halving) {
        double centre[2] = {best[0], best[1]};
        step[0] *= 0.5;
        step[1] *= 0.5;
        for (int i = -1; i <= 1; ++i)
            for (int k = -1; k <= 1; ++k) {
                double shape[2] = {centre[0] + step[0] * i, centre[1] + step[1] * k};
                double found = i == 0 && k == 0 ? HUGE_VAL : try_shape(search, shape);
                if (found < least) {
                    least = found;
                    best[0] = shape[0];
                    best[1] = shape[1];
                }
            }
    }
}

dph_verdict dph_paper_limited_make(dph_plan *plan)
{
    Search search = {.plan = plan};
    dph_verdict verdict = dph_path_make(plan);
    if (verdict.status == DPH_STATUS_OK)
        verdict = dph_limits_make(&plan->task.limits, &search.bounds);
    if (verdict.status == DPH_STATUS_OK)
        verdict = dph_path_check(plan);
    if (verdict.status == DPH_STATUS_OK)
        verdict = dph_path_gravity_check(plan, &search.bounds);
    if (verdict.status != DPH_STATUS_OK)
        return verdict;

    /* The given speeds are a shape too: the result is never slower than they are, uniformly slowed down. */
    double given[2] = {log(plan->task.corner_mid_speed / plan->task.corner_entry_speed),
                       log(plan->task.traverse_speed / plan->task.corner_entry_speed)};
    double best[2] = {given[0], given[1]};
    search_shape(&search, best);
    double by_given = settle(&search, given), by_best = settle(&search, best);
    if (by_given < by_best)
        (void)settle(&search, given);
    return dph_accept();
}
