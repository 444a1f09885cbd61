/* The time-optimal law: the fastest motion along the path within limits of joint velocity, acceleration, jerk, torque and tcp speed, from
 * rest to rest with continuous acceleration. The solver keeps the limits at its nodes; what happens between them is verified here, repaired
 * once, and made good by one factor. Where only velocity and acceleration are limited, reachability.c does all of it. */
#include "time_optimal.h"

#include <math.h>
#include <string.h>

#include "laws.h"
#include "quadrature.h"

/* Iterations at most, and relative gaps: the first run ends near enough to the optimum, the second one continues from there. */
enum { FIRST_ITERATIONS = 25, REPAIRS = 2, REPAIR_ITERATIONS = 15 };
static const double first_gap = 0.5, repair_gap = 0.02, tolerance = 3e-3;

/* A stretch not worth a repair. */
static const double enough = 1.001;

/* What the parabolas of the verification may have missed, as a ratio of velocities: found to be below 2e-4 for jerk, its cube. */
static const double unseen = 1.0001;

int dph_workspace_size(void)
{
    return (int)sizeof(dph_workspace);
}

/* ---- Verification ----------------------------------------------------------------------------------------------------------------- */

/* Greatest absolute value of a smooth function by its samples and the tops of the parabolas through any three neighbours. */
static double peak_of(const double f[DPH_FINE + 1])
{
    double peak = 0.0;
    for (int i = 0; i <= DPH_FINE; ++i)
        peak = fabs(f[i]) > peak ? fabs(f[i]) : peak;
    for (int i = 1; i < DPH_FINE; ++i) {
        double sign = f[i] < 0.0 ? -1.0 : 1.0, here = sign * f[i], rise = sign * (f[i + 1] - f[i - 1]);
        double bend = 2.0 * here - sign * (f[i + 1] + f[i - 1]);
        if (fabs(rise) <= 2.0 * bend) { /* the top is between the outer two */
            double top = here + rise * rise / (8.0 * bend);
            peak = top > peak ? top : peak;
        }
    }
    return peak;
}

/* How far b goes beyond the limits in an interval: ratios of velocity^2; acceleration or torque; jerk; at most 1 where all is kept.
 * Returns 0 where b is not positive. */
static int excess_of(const dph_workspace *w, int k, double excess[3])
{
    double width = w->knot[k + 1] - w->knot[k], slope[2] = {width * w->slope[k], width * w->slope[k + 1]};
    double series[1 + DPH_ROWS][DPH_FINE + 1];
    int count[2] = {0, 0};
    if (!dph_is_positive(&w->b[k], slope))
        return 0;
    for (int i = 0; i <= DPH_FINE; ++i) {
        double v[3], c[DPH_ROWS][3], offset[DPH_ROWS];
        dph_hermite(&w->b[k], slope, (double)i / DPH_FINE, v);
        v[1] /= width;
        v[2] /= width * width;
        dph_rows_at(&w->bounds, &w->point[k][i], c, offset, count);
        series[0][i] = v[0] * dph_inverse_cap(&w->bounds, &w->point[k][i]);
        double root = sqrt(v[0]);
        for (int row = 0; row < count[0] + count[1]; ++row) {
            double x = c[row][0] * v[0] + c[row][1] * v[1] + c[row][2] * v[2];
            /* Gravity does not shrink with speed: what counts is the room it leaves on the side of x. */
            series[1 + row][i] = row >= count[0] ? x * root : x / (1.0 - (x > 0.0 ? offset[row] : -offset[row]));
        }
    }
    excess[0] = peak_of(series[0]);
    excess[1] = excess[2] = 0.0;
    for (int row = 0; row < count[0] + count[1]; ++row) {
        double peak = peak_of(series[1 + row]), *greatest = &excess[row < count[0] ? 1 : 2];
        *greatest = peak > *greatest ? peak : *greatest;
    }
    return 1;
}

/* Verify an interval: by how much it goes beyond its limits, for tighten() and for stretch_of(). Returns 0 where b is not positive. */
static int verify(dph_workspace *w, int k)
{
    double excess[3];
    if (!excess_of(w, k, excess))
        return 0;
    for (int i = 0; i < 3; ++i) {
        w->excess[i] = excess[i] > w->excess[i] ? excess[i] : w->excess[i];
        w->tighten[k][i] = excess[i] > 1.0 ? excess[i] : 1.0;
    }
    return 1;
}

/* The factor by which time has to be stretched to keep all limits, at least 1; all intervals are verified. */
static double stretch_of(const dph_workspace *w)
{
    double stretch = sqrt(w->excess[0]), by_acceleration = sqrt(w->excess[1]), by_jerk = cbrt(w->excess[2]);
    stretch = stretch > by_acceleration ? stretch : by_acceleration;
    stretch = stretch > by_jerk ? stretch : by_jerk;
    return stretch > 1.0 ? stretch : 1.0;
}

/* Give the intervals that went beyond their limits tighter ones. A knot's velocity and acceleration are constraints of the interval behind
 * it: they take the tighter one of both. */
static void tighten(dph_workspace *w)
{
    for (int k = 0; k < w->intervals; ++k)
        for (int j = 0; j < DPH_NODES; ++j) {
            dph_node *node = &w->node[k][j];
            const double *own = w->tighten[k], *before = w->tighten[j == 0 && k > 0 ? k - 1 : k];
            double ratio[2] = {own[0] > before[0] ? own[0] : before[0], own[1] > before[1] ? own[1] : before[1]};
            node->cap *= ratio[0];
            for (int i = 0; i < node->rows[0] + node->rows[1]; ++i)
                for (int order = 0; order < 3; ++order)
                    node->row[i].c[order] *= i < node->rows[0] ? ratio[1] : own[2];
        }
}

/* ---- The law ---------------------------------------------------------------------------------------------------------------------- */

typedef struct Cubic {
    double value[2], slope[2]; /* slopes by u */
} Cubic;

static Cubic cubic_of(const dph_plan *plan, int piece, double *width)
{
    *width = plan->parameter[piece + 1] - plan->parameter[piece];
    Cubic cubic = {{plan->b[piece], plan->b[piece + 1]}, {*width * plan->b_slope[piece], *width * plan->b_slope[piece + 1]}};
    return cubic;
}

/* dt / dx at a point u of a piece. */
static double slowness(double u, const void *context)
{
    const Cubic *cubic = context;
    const double *value = cubic->value, *slope = cubic->slope;
    double r = 1.0 - u; /* b as in dph_hermite, alone */
    return 1.0 / sqrt(value[0] * r * r * (1.0 + 2.0 * u) + value[1] * u * u * (3.0 - 2.0 * u) + slope[0] * u * r * r - slope[1] * u * u * r);
}

/* Is one Gauss quadrature enough from u = begin to end? Of a linear b the root is then half the interval away (quadrature.h); for a cubic,
 * whose Bezier points are looked at, 7e-12 was the greatest relative error of 700,000 pieces of random plans. */
static int is_even(const Cubic *cubic, double begin, double end)
{
    double first[3], last[3], third = (end - begin) / 3.0;
    dph_hermite(cubic->value, cubic->slope, begin, first);
    dph_hermite(cubic->value, cubic->slope, end, last);
    double inner[2] = {first[0] + third * first[1], last[0] - third * last[1]};
    double least = fmin(fmin(first[0], last[0]), fmin(inner[0], inner[1]));
    double most = fmax(fmax(first[0], last[0]), fmax(inner[0], inner[1]));
    return !(most > 3.0 * least);
}

/* Integral of slowness, in parts that shrink to where b almost vanishes, as behind a corner of micrometres. */
static double time_between(const Cubic *cubic, double begin, double end)
{
    static const double shortest = 1e-9; /* b > 1e-14 of its scale (dph_is_positive): even over some 1e-7 */
    double time = 0.0, to = end;
    while (begin < end) {
        if (to - begin > shortest && !is_even(cubic, begin, to)) {
            to = 0.5 * (begin + to);
            continue;
        }
        time += gauss_integral(slowness, cubic, begin, to);
        begin = to;
        to = end;
    }
    return time;
}

/* Integral of slowness over a piece on which b is quadratic, b'' = 2c: with r = sqrt(b0) + sqrt(b1) it is 2 artanh(sqrt(z)) / (r sqrt(z)),
 * z = c / r^2, real for either sign. Of its series 2/r (1 + z/3 + z^2/5 + ...) the first term that is left out is below 1e-17 for |z| < 1/16. */
static double quadratic_integral(const Cubic *cubic)
{
    static const double term[] = {1.0,        1.0 / 3.0,  1.0 / 5.0,  1.0 / 7.0,  1.0 / 9.0,  1.0 / 11.0, 1.0 / 13.0,
                                  1.0 / 15.0, 1.0 / 17.0, 1.0 / 19.0, 1.0 / 21.0, 1.0 / 23.0, 1.0 / 25.0};
    double r = sqrt(cubic->value[0]) + sqrt(cubic->value[1]), z = 0.5 * (cubic->slope[1] - cubic->slope[0]) / (r * r), sum = 0.0;
    if (!(fabs(z) < 1.0 / 16.0))
        return time_between(cubic, 0.0, 1.0);
    for (int k = (int)(sizeof term / sizeof *term) - 1; k >= 0; --k)
        sum = sum * z + term[k];
    return 2.0 * sum / r;
}

static void keep(const dph_workspace *w, double stretch, int is_quadratic, dph_plan *plan)
{
    double factor = 1.0 / (stretch * stretch);
    plan->pieces = w->intervals;
    for (int k = 0; k <= w->intervals; ++k) {
        double y[4];
        plan->parameter[k] = w->knot[k];
        plan->b[k] = factor * w->b[k];
        plan->b_slope[k] = factor * w->slope[k];
        int place = w->segment[k < w->intervals ? k : k - 1] >= 3;
        dph_parameter_at(place ? 1.0 - w->knot[k] : w->knot[k], y);
        plan->arc_boundary[k] = place ? plan->length - plan->length * y[0] : plan->length * y[0];
    }
    plan->boundary[0] = 0.0;
    for (int k = 0; k < w->intervals; ++k) {
        double width;
        Cubic cubic = cubic_of(plan, k, &width);
        plan->phase[k] = dph_segment_phase[w->segment[k]];
        plan->boundary[k + 1] = plan->boundary[k] + width * (is_quadratic ? quadratic_integral(&cubic) : time_between(&cubic, 0.0, 1.0));
    }
}

/* Keep what the solver holds, which keeps all limits once it is stretched, if it is the shortest motion so far. */
static void remember(dph_workspace *w, double stretch)
{
    double duration = 0.0;
    for (int k = 0; k < w->intervals; ++k) {
        double width = w->knot[k + 1] - w->knot[k];
        Cubic cubic = {{w->b[k], w->b[k + 1]}, {width * w->slope[k], width * w->slope[k + 1]}};
        for (int j = 0; j < DPH_NODES; ++j)
            duration += stretch * w->unit * w->node[k][j].weight * slowness(0.25 * j, &cubic);
    }
    if (duration < w->best.duration) {
        memcpy(w->best.b, w->b, sizeof w->b);
        memcpy(w->best.slope, w->slope, sizeof w->slope);
        w->best.stretch = stretch;
        w->best.duration = duration;
    }
}

static void back_to_the_best(dph_workspace *w)
{
    memcpy(w->b, w->best.b, sizeof w->b);
    memcpy(w->slope, w->best.slope, sizeof w->slope);
}

/* ---- Slices ----------------------------------------------------------------------------------------------------------------------- */

/* What comes next. VERIFY_BEST: for its tightened limits, where the solver has left none. */
enum { BEGIN, REACH, LAY, PROFILE, INTERVAL, START, VERIFY, VERIFY_BEST, REPAIR, SOLVE, KEEP };

/* Work [units], measured; all but the first two for each interval. */
enum { REACH_UNITS = 140, PROFILE_UNITS = 80, INTERVAL_UNITS = 12, START_UNITS = 1, VERIFY_UNITS = 3, REPAIR_UNITS = 1, SOLVE_UNITS = 2 };

static void enter(dph_workspace *w, int stage)
{
    w->stage = stage;
    w->next = 0;
    memset(w->excess, 0, sizeof w->excess);
}

void dph_time_optimal_begin(dph_workspace *w)
{
    enter(w, BEGIN);
    memset(&w->laying, 0, sizeof w->laying);
    w->runs = 0;
}

/* What the solver holds is verified; it is no motion where b is not positive between the nodes. The start is a motion too, and so is every
 * result; kept is the shortest one. */
static void judge(dph_workspace *w, int is_motion)
{
    double stretch = is_motion ? stretch_of(w) : HUGE_VAL;
    if (is_motion)
        remember(w, stretch);
    if (w->runs == 0) {
        enter(w, SOLVE);
    } else if (!(stretch > enough) || w->runs > REPAIRS) {
        enter(w, KEEP);
    } else if (is_motion) {
        enter(w, REPAIR);
    } else {
        back_to_the_best(w);
        enter(w, VERIFY_BEST);
    }
}

/* An iteration of the solver. Returned: 0 after the last one. */
static int iterate(dph_workspace *w)
{
    int first = w->runs == 0;
    double gap = first ? first_gap : repair_gap;
    if (w->next++ == 0)
        dph_interior_point_begin(w, gap);
    return dph_interior_point_iterate(w, gap, tolerance) && w->iteration < (first ? FIRST_ITERATIONS : REPAIR_ITERATIONS);
}

static void run_is_over(dph_workspace *w)
{
    w->runs += 1;
    enter(w, VERIFY);
}

dph_verdict dph_time_optimal_continue(dph_workspace *w, dph_plan *plan, int *units)
{
    dph_verdict verdict = dph_accept();
    while (*units > 0 && verdict.status == DPH_STATUS_OK) {
        int is_clear = 0;
        switch (w->stage) {
        case BEGIN:
            verdict = dph_path_begin(plan, &w->bounds, &w->laying, units);
            w->best.stretch = 0.0;
            enter(w, w->bounds.has_jerk || w->bounds.has_torque ? LAY : REACH);
            break;
        case REACH:
            *units -= REACH_UNITS;
            w->best.stretch = dph_reachability(plan, w, &is_clear);
            if (w->best.stretch > 0.0 && is_clear) {
                keep(w, w->best.stretch, 1, plan);
                return verdict;
            }
            enter(w, LAY);
            break;
        case LAY:
            verdict = dph_path_lay(plan, &w->bounds, &w->laying, units);
            if (verdict.status == DPH_STATUS_OK && w->best.stretch > 0.0) {
                keep(w, w->best.stretch, 1, plan);
                return verdict;
            }
            if (verdict.status == DPH_STATUS_OK)
                enter(w, PROFILE);
            break;
        case PROFILE:
            *units -= PROFILE_UNITS;
            dph_profile_begin(plan, w);
            enter(w, INTERVAL);
            break;
        case INTERVAL:
            *units -= INTERVAL_UNITS;
            dph_profile_interval(plan, w, w->next++);
            if (w->next == w->intervals)
                enter(w, START);
            break;
        case START:
            *units -= w->intervals * START_UNITS;
            if (dph_profile_start(w, w->next++)) {
                w->best.duration = HUGE_VAL; /* at the nodes only; what counts is its verification */
                enter(w, VERIFY);
            }
            break;
        case VERIFY:
            *units -= VERIFY_UNITS;
            if (!verify(w, w->next++))
                judge(w, 0);
            else if (w->next == w->intervals)
                judge(w, 1);
            break;
        case VERIFY_BEST:
            *units -= VERIFY_UNITS;
            if (!verify(w, w->next++) || w->next == w->intervals)
                enter(w, REPAIR);
            break;
        case REPAIR:
            *units -= w->intervals * REPAIR_UNITS;
            tighten(w);
            if (dph_profile_fit(w) < HUGE_VAL)
                enter(w, SOLVE);
            else
                run_is_over(w);
            break;
        case SOLVE:
            *units -= w->intervals * SOLVE_UNITS;
            if (!iterate(w))
                run_is_over(w);
            break;
        default: /* KEEP */
            back_to_the_best(w);
            keep(w, w->best.stretch * unseen, 0, plan);
            return verdict;
        }
    }
    return verdict.status == DPH_STATUS_OK ? dph_unfinished() : verdict;
}

void dph_time_optimal_at(const dph_plan *plan, int piece, double t, dph_planar *motion)
{
    double width, begin = plan->boundary[piece], end = plan->boundary[piece + 1];
    Cubic cubic = cubic_of(plan, piece, &width);
    double low = 0.0, high = 1.0, u = (t - begin) / (end - begin);

    /* Newton's method on t(u), from the nearer end, within a shrinking bracket: t increases with u. A step below 1e-9 leaves an error of
     * about its square. */
    for (int i = 0; i < 60; ++i) {
        double residual = t - begin < end - t ? begin + width * time_between(&cubic, 0.0, u) - t
                                              : end - width * time_between(&cubic, u, 1.0) - t;
        double step = -residual / (width * slowness(u, &cubic)), next = u + step;
        if (residual > 0.0)
            high = u;
        else
            low = u;
        u = next >= low && next <= high ? next : 0.5 * (low + high);
        if (fabs(step) < 1e-9)
            break;
    }

    double b[3], by_parameter[4][2], ds;
    int segment = 0;
    while (segment < SEGMENTS - 1 && dph_segment_phase[segment] != plan->phase[piece])
        ++segment;
    dph_hermite(cubic.value, cubic.slope, u, b);
    double x = u < 1.0 ? plan->parameter[piece] + u * width : plan->parameter[piece + 1];
    dph_path_by_parameter(plan, segment, x, by_parameter, &ds, &motion->arc_length);
    double x1 = sqrt(b[0]), x2 = 0.5 * b[1] / width, x3 = 0.5 * x1 * b[2] / (width * width); /* time derivatives of x */
    motion->side = segment >= 3;
    for (int i = 0; i < 2; ++i) {
        motion->d[0][i] = by_parameter[0][i];
        motion->d[1][i] = by_parameter[1][i] * x1;
        motion->d[2][i] = by_parameter[2][i] * x1 * x1 + by_parameter[1][i] * x2;
        motion->d[3][i] = by_parameter[3][i] * x1 * x1 * x1 + 3.0 * by_parameter[2][i] * x1 * x2 + by_parameter[1][i] * x3;
    }
}
