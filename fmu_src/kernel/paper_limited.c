/* The paper's law, as fast as the limits allow: a search over its three speeds.
 *
 * All three speeds times f are the same motion on a clock f times as fast: velocity grows with f, acceleration and the dynamic part of
 * torque with f^2, jerk with f^3. What is searched is therefore the shape alone, two ratios of speeds; the greatest f of a shape follows
 * from its peaks. */
#include <math.h>
#include <string.h>

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

static void keep_greatest(double value, double *greatest)
{
    if (!(value <= *greatest))
        *greatest = value;
}

/* Make the paper's plan with these speeds, on its nominal clock; its path is laid. */
static void plan_with(dph_plan *plan, double corner_entry, const double shape[2])
{
    dph_task *task = &plan->task;
    task->corner_entry_speed = corner_entry;
    task->corner_mid_speed = corner_entry * exp(shape[0]);
    task->traverse_speed = corner_entry * exp(shape[1]);
    dph_paper_move(plan);
    plan->speed_factor = 1.0;
}

static double duration(const dph_plan *plan)
{
    return plan->boundary[plan->pieces];
}

/* 1 / f^2 by the torque at one instant. */
static double torque_ratio(dph_search *search, const dph_plan *plan, const dph_setpoint *s)
{
    dph_setpoint rest;
    double greatest = 0.0;
    (void)dph_rest(&plan->robot, s->tcp_position, plan->task.payload, &rest);
    for (int i = 0; i < 3; ++i) {
        double still = rest.joint_torque[i] * search->bounds.torque[i];
        double moving = (s->joint_torque[i] - rest.joint_torque[i]) * search->bounds.torque[i];
        keep_greatest(moving > 0.0 ? moving / (1.0 - still) : -moving / (1.0 + still), &greatest);
        keep_greatest(fabs(still), &search->gravity);
    }
    return greatest;
}

/* Greatest f by samples of the present plan. */
static double factor_by_samples(dph_search *search, const dph_plan *plan)
{
    const dph_bounds *bounds = &search->bounds;
    double velocity = 0.0, acceleration = 0.0, jerk = 0.0;
    for (int piece = 0; piece < plan->pieces; ++piece) {
        double begin = plan->boundary[piece], step = (plan->boundary[piece + 1] - begin) / SAMPLES;
        if (!(step > 0.0))
            continue;
        for (int k = 0; k <= SAMPLES; ++k) {
            dph_setpoint s;
            dph_plan_sample_piece(plan, piece, begin + step * k, &s);
            for (int i = 0; i < 3; ++i) {
                keep_greatest(fabs(s.joint_velocity[i]) * bounds->velocity[i], &velocity);
                keep_greatest(fabs(s.joint_acceleration[i]) * bounds->acceleration[i], &acceleration);
                keep_greatest(fabs(s.joint_jerk[i]) * bounds->jerk[i], &jerk);
            }
            keep_greatest(hypot(hypot(s.tcp_velocity[0], s.tcp_velocity[1]), s.tcp_velocity[2]) * bounds->tcp_speed, &velocity);
            if (bounds->has_torque)
                keep_greatest(torque_ratio(search, plan, &s), &acceleration);
        }
    }
    double slowest = velocity;
    keep_greatest(sqrt(acceleration), &slowest);
    keep_greatest(cbrt(jerk), &slowest);
    return 1.0 / slowest;
}

/* Greatest f by the exact peaks of the present plan, whose torque is near its limit. */
static double factor_by_peaks(const dph_search *search)
{
    const dph_bounds *bounds = &search->bounds;
    dph_peaks peaks;
    dph_peaks_of(&search->peaks, &peaks);
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

/* Duration of the plan of a shape, as fast as the samples allow [s]. */
static double try_shape(dph_search *search, dph_plan *plan, const double shape[2])
{
    plan_with(plan, 1.0, shape);
    double f = factor_by_samples(search, plan);
    if (!(f > 0.0) || !isfinite(f))
        return HUGE_VAL;
    return duration(plan) / f;
}

/* ---- Slices ----------------------------------------------------------------------------------------------------------------------- */

/* What comes next; SETTLING and PEAKS for the given shape, then for the best one. */
enum { SEARCH_BEGINS, SEARCHING, SETTLING, PEAKS };

/* Work of a candidate [units], measured: half a unit for each sample, and as much again where there are torques. */
static int try_units(const dph_search *search)
{
    enum { SETPOINTS = 6 * (SAMPLES + 1) };
    return DPH_CORNER_UNITS + (search->bounds.has_torque ? SETPOINTS : SETPOINTS / 2);
}

/* Candidates: the given shape, the grid, then eight around the best one for each halving. The grid has one column more: without any change
 * of speed on the traverse; where the corners leave next to nothing of it, nothing else will do. */
enum { COLUMNS = GRID + 1, BY_GRID = 1 + GRID * COLUMNS, CANDIDATES = BY_GRID + 8 * HALVINGS };

static void candidate_at(dph_search *search, int n, double shape[2])
{
    if (n == 0) {
        memcpy(shape, search->shape[0], sizeof search->shape[0]);
    } else if (n < BY_GRID) {
        int column = (n - 1) % COLUMNS - 1;
        shape[0] = shape_low[0] + search->step[0] * ((n - 1) / COLUMNS);
        shape[1] = column < 0 ? 0.0 : shape_low[1] + search->step[1] * column;
    } else {
        int around = (n - BY_GRID) % 8;
        if (around == 0)
            for (int axis = 0; axis < 2; ++axis) {
                search->centre[axis] = search->shape[1][axis];
                search->step[axis] *= 0.5;
            }
        around += around >= 4; /* leaving out the centre itself */
        shape[0] = search->centre[0] + search->step[0] * (around / 3 - 1);
        shape[1] = search->centre[1] + search->step[1] * (around % 3 - 1);
    }
}

static void try_candidate(dph_search *search, dph_plan *plan)
{
    double shape[2];
    candidate_at(search, search->candidate, shape);
    double found = try_shape(search, plan, shape);
    if (search->candidate++ == 0 || found < search->least) {
        search->least = found;
        memcpy(search->shape[1], shape, sizeof shape);
    }
}

static void begin_search(dph_search *search, const dph_task *task)
{
    /* The given speeds are a shape too: the result is never slower than they are, uniformly slowed down. */
    search->shape[0][0] = log(task->corner_mid_speed / task->corner_entry_speed);
    search->shape[0][1] = log(task->traverse_speed / task->corner_entry_speed);
    for (int axis = 0; axis < 2; ++axis)
        search->step[axis] = (shape_high[axis] - shape_low[axis]) / (GRID - 1);
    search->candidate = 0;
    search->stage = SEARCHING;
}

/* The plan of a shape, as fast as the samples allow; then its peaks say how fast it may be, torque included. */
static void settle_by_samples(dph_search *search, dph_plan *plan)
{
    const double *shape = search->shape[search->settling];
    plan_with(plan, 1.0, shape);
    search->factor[search->settling] = factor_by_samples(search, plan);
    plan_with(plan, search->factor[search->settling], shape);
    dph_peaks_begin(&search->peaks);
    search->stage = PEAKS;
}

static void settle_by_peaks(dph_search *search, dph_plan *plan)
{
    double *factor = &search->factor[search->settling];
    *factor *= factor_by_peaks(search);
    plan_with(plan, *factor, search->shape[search->settling]);
    search->duration[search->settling++] = duration(plan);
    search->stage = SETTLING;
}

dph_verdict dph_paper_limited_continue(dph_search *search, dph_plan *plan, int *units)
{
    dph_verdict verdict = dph_accept();
    while (*units > 0 && verdict.status == DPH_STATUS_OK) {
        switch (search->stage) {
        case SEARCH_BEGINS:
            verdict = dph_path_lay(plan, &search->bounds, &search->laying, units);
            if (verdict.status == DPH_STATUS_OK)
                begin_search(search, &plan->task);
            break;
        case SEARCHING:
            *units -= try_units(search);
            try_candidate(search, plan);
            if (search->candidate == CANDIDATES)
                search->stage = SETTLING;
            break;
        case SETTLING:
            if (search->settling == 2) {
                if (search->duration[0] < search->duration[1])
                    plan_with(plan, search->factor[0], search->shape[0]);
                return verdict;
            }
            *units -= try_units(search);
            settle_by_samples(search, plan);
            break;
        default: /* PEAKS */
            if (dph_peaks_continue(plan, &search->peaks, units))
                settle_by_peaks(search, plan);
            break;
        }
    }
    return verdict.status == DPH_STATUS_OK ? dph_unfinished() : verdict;
}
