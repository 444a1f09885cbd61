/* A crude profile b(x), good for two things: where time passes, and so where knots belong; and a strictly feasible start of the solver. */
#include <math.h>
#include <string.h>

#include "time_optimal.h"

/* Knots: about this many intervals; at least so many in each segment of a side. */
enum { INTERVALS = 48 };
static const int least_intervals[3] = {3, 10, 3};

/* Half of a straight traverse that is shorter than this, by the path parameter, has no knots of its own: as good as no segment, and
 * second differences over it would be rounding errors. One shorter than `one_interval` has a single interval. */
static const double shortest = 1e-8, one_interval = 1e-3;

/* Share of the bounds that the start keeps away from. */
static const double reserve = 0.9;

/* ---- The crude profile ------------------------------------------------------------------------------------------------------------ */

/* Greatest b at a point, leaving b' alone. */
static double cap_at(const dph_bounds *bounds, const dph_path_point *point)
{
    double c[DPH_ROWS][3], offset[DPH_ROWS], cap = 1.0 / dph_inverse_cap(bounds, point);
    int count[2];
    dph_rows_at(bounds, point, c, offset, count);
    for (int i = 0; i < count[0] + count[1]; ++i) {
        double room = i < count[0] ? 1.0 - fabs(offset[i]) : 1.0, limit = room / fabs(c[i][0]);
        if (i >= count[0]) /* jerk: b^3/2 */
            limit = pow(limit, 2.0 / 3.0);
        if (limit < cap)
            cap = limit;
    }
    return cap;
}

/* Greatest |b'| that the acceleration and torque rows leave at b. */
static double slope_at(const dph_bounds *bounds, const dph_path_point *point, double b)
{
    double c[DPH_ROWS][3], offset[DPH_ROWS], slope = HUGE_VAL;
    int count[2];
    dph_rows_at(bounds, point, c, offset, count);
    for (int i = 0; i < count[0]; ++i) {
        double room = 1.0 - fabs(offset[i]) - fabs(c[i][0]) * b;
        double limit = room > 0.0 ? room / fabs(c[i][1]) : 0.0;
        if (limit < slope)
            slope = limit;
    }
    return slope;
}

static void profile_caps(dph_workspace *w)
{
    double *b = w->profile, step = 1.0 / DPH_COARSE;
    for (int i = 0; i <= DPH_COARSE; ++i)
        b[i] = cap_at(&w->bounds, &w->coarse[i]);
    /* Without a jerk limit nothing else bounds b where the path begins and ends. */
    b[0] = b[0] < 2.0 * b[1] ? b[0] : 2.0 * b[1];
    b[DPH_COARSE] = b[DPH_COARSE] < 2.0 * b[DPH_COARSE - 1] ? b[DPH_COARSE] : 2.0 * b[DPH_COARSE - 1];
    for (int i = 0; i < DPH_COARSE; ++i) {
        double reach = b[i] + step * slope_at(&w->bounds, &w->coarse[i], b[i]);
        b[i + 1] = b[i + 1] < reach ? b[i + 1] : reach;
    }
    for (int i = DPH_COARSE; i > 0; --i) {
        double reach = b[i] + step * slope_at(&w->bounds, &w->coarse[i], b[i]);
        b[i - 1] = b[i - 1] < reach ? b[i - 1] : reach;
    }
}

/* Each value replaced by the least of it and its neighbours. */
static void profile_erode(double b[])
{
    double before = b[0];
    for (int i = 0; i <= DPH_COARSE; ++i) {
        double here = b[i], after = i < DPH_COARSE ? b[i + 1] : here, least = before < here ? before : here;
        b[i] = after < least ? after : least;
        before = here;
    }
}

static void profile_smooth(double b[], int passes)
{
    for (; passes > 0; --passes) {
        double before = b[0];
        for (int i = 0; i <= DPH_COARSE; ++i) {
            double here = b[i], after = i < DPH_COARSE ? b[i + 1] : here;
            b[i] = 0.25 * (before + 2.0 * here + after);
            before = here;
        }
    }
}

/* ---- Knots ------------------------------------------------------------------------------------------------------------------------ */

/* Share of knots up to each coarse point: half by parameter, half by time. */
static void density(const dph_workspace *w, dph_shares *shares)
{
    double time[DPH_COARSE + 1];
    time[0] = 0.0;
    for (int i = 0; i < DPH_COARSE; ++i)
        time[i + 1] = time[i] + 2.0 / (sqrt(w->profile[i]) + sqrt(w->profile[i + 1]));
    for (int i = 0; i <= DPH_COARSE; ++i) {
        shares->at[i] = (double)i / DPH_COARSE;
        shares->share[i] = 0.5 * shares->at[i] + 0.5 * time[i] / time[DPH_COARSE];
    }
    shares->intervals = DPH_COARSE;
}

/* A rising function by its values at points, between them linear: the interval of `value` among n. */
static int interval_of(const double at[], int n, double value)
{
    int low = 0, high = n;
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (at[middle] <= value)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static double interpolate(const double from[], const double to[], int n, double value)
{
    int i = interval_of(from, n, value);
    return to[i] + (value - from[i]) / (from[i + 1] - from[i]) * (to[i + 1] - to[i]);
}

void dph_knots_lay(const dph_plan *plan, const dph_shares *shares, int intervals, const int least[3], dph_workspace *w)
{
    double end[SEGMENTS + 1];
    end[0] = 0.0;
    for (int segment = 1; segment < SEGMENTS; ++segment) {
        double arc = plan->segment_arc[segment];
        end[segment] = segment <= 3 ? dph_parameter_of(arc / plan->length) : 1.0 - dph_parameter_of((plan->length - arc) / plan->length);
    }
    end[SEGMENTS] = 1.0;

    double begin = 0.0;
    w->intervals = 0;
    w->knot[0] = 0.0;
    for (int segment = 0; segment < SEGMENTS; ++segment) {
        double to = end[segment + 1];
        int straight = segment == 2 || segment == 3;
        if (!(to > begin) || (straight && to - begin < shortest))
            continue; /* the next one begins where this one would */
        double low = interpolate(shares->at, shares->share, shares->intervals, begin);
        double high = interpolate(shares->at, shares->share, shares->intervals, to);
        int at_least = least[segment < 3 ? segment : 5 - segment], n = (int)(intervals * (high - low) + 0.5);
        n = straight && to - begin < one_interval ? 1 : n > at_least ? n : at_least;
        int room = DPH_PIECES - w->intervals - (SEGMENTS - 1 - segment) * 10;
        n = n < room ? n : room;
        for (int i = 1; i <= n; ++i) {
            w->inner[w->intervals] = i == 1 ? end[segment] : w->knot[w->intervals];
            w->segment[w->intervals++] = segment;
            w->knot[w->intervals] =
                i == n ? to : interpolate(shares->share, shares->at, shares->intervals, low + (high - low) * i / n);
        }
        begin = to;
    }
}

/* ---- Start ------------------------------------------------------------------------------------------------------------------------ */

/* Boole's rule on the five nodes of an interval. */
static const double quadrature[DPH_NODES] = {7.0 / 90.0, 32.0 / 90.0, 12.0 / 90.0, 32.0 / 90.0, 7.0 / 90.0};

static void lay_basis(dph_workspace *w)
{
    for (int j = 0; j < DPH_NODES; ++j)
        for (int unknown = 0; unknown < 4; ++unknown) {
            double value[2] = {unknown == 0, unknown == 2}, slope[2] = {unknown == 1, unknown == 3}, v[3];
            dph_hermite(value, slope, 0.25 * j, v);
            for (int order = 0; order < 3; ++order)
                w->basis[j][order][unknown] = v[order];
        }
}

void dph_profile_interval(const dph_plan *plan, dph_workspace *w, int k)
{
    double width = w->knot[k + 1] - w->knot[k];
    int last = k + 1 == w->intervals;
    for (int i = 0; i <= DPH_FINE; ++i)
        dph_path_point_at(plan, &w->bounds, w->segment[k],
                          i == 0          ? w->inner[k]
                          : i == DPH_FINE ? w->knot[k + 1]
                                          : w->knot[k] + width * i / DPH_FINE,
                          &w->point[k][i]);
    for (int i = 0; i < 3; ++i)
        w->tighten[k][i] = 1.0;
    for (int j = 0; j < DPH_NODES; ++j) {
        dph_node *node = &w->node[k][j];
        const dph_path_point *point = &w->point[k][j * DPH_FINE / (DPH_NODES - 1)];
        double c[DPH_ROWS][3], offset[DPH_ROWS];
        dph_rows_at(&w->bounds, point, c, offset, node->rows);
        /* Velocity and acceleration at a knot are constraints of the interval behind it alone; jerk, which jumps there, of both.
         * In between, jerk is constrained in the middle; at all nodes where the path begins and ends, and b'' is not seen there. */
        int repeats = j == DPH_NODES - 1 && !last, with_jerk = j % 2 == 0 || k == 0 || last, first = repeats ? node->rows[0] : 0;
        node->cap = repeats ? 0.0 : dph_inverse_cap(&w->bounds, point);
        node->weight = quadrature[j] * width;
        for (int i = first; i < node->rows[0] + node->rows[1]; ++i) {
            dph_row *row = &node->row[i - first];
            row->c[0] = c[i][0];
            row->c[1] = c[i][1] / width;
            row->c[2] = c[i][2] / (width * width);
            row->offset = offset[i];
        }
        node->rows[0] -= first;
        node->rows[1] = with_jerk ? node->rows[1] : 0;
    }
}

/* b, b' at the knots from the crude profile, by a cubic through its points. */
static void sample_profile(dph_workspace *w, const double profile[])
{
    for (int k = 0; k <= w->intervals; ++k) {
        double at = w->knot[k] * DPH_COARSE, value[2], slope[2], v[3];
        int i = (int)at;
        i = i < DPH_COARSE ? i : DPH_COARSE - 1;
        for (int end = 0; end < 2; ++end) {
            int here = i + end, before = here > 0 ? here - 1 : 0, after = here < DPH_COARSE ? here + 1 : DPH_COARSE;
            value[end] = profile[here];
            slope[end] = (profile[after] - profile[before]) / (after - before);
        }
        dph_hermite(value, slope, at - i, v);
        w->b[k] = v[0];
        w->slope[k] = v[1] * DPH_COARSE;
    }
}

double dph_profile_fit(dph_workspace *w)
{
    double inverse = 0.0, time = 0.0; /* 1 / greatest factor */
    for (int k = 0; k < w->intervals; ++k) {
        double width = w->knot[k + 1] - w->knot[k], slope[2] = {width * w->slope[k], width * w->slope[k + 1]}, v[3];
        if (!dph_is_positive(&w->b[k], slope))
            return HUGE_VAL;
        for (int j = 0; j < DPH_NODES; ++j) {
            const dph_node *node = &w->node[k][j];
            dph_hermite(&w->b[k], slope, 0.25 * j, v);
            double root = sqrt(v[0]);
            time += node->weight / root;
            inverse = inverse > node->cap * v[0] ? inverse : node->cap * v[0];
            for (int i = 0; i < node->rows[0] + node->rows[1]; ++i) {
                const dph_row *row = &node->row[i];
                double x = fabs(row->c[0] * v[0] + row->c[1] * v[1] + row->c[2] * v[2]);
                double ratio = i < node->rows[0] ? x / (1.0 - fabs(row->offset)) : pow(x * root, 2.0 / 3.0);
                inverse = inverse > ratio ? inverse : ratio;
            }
        }
    }
    double factor = reserve / inverse;
    for (int k = 0; k <= w->intervals; ++k) {
        w->b[k] *= factor;
        w->slope[k] *= factor;
    }
    time /= sqrt(factor);
    return time > 0.0 ? time : HUGE_VAL;
}

void dph_profile_begin(const dph_plan *plan, dph_workspace *w)
{
    int segment = 0;
    for (int i = 0; i <= DPH_COARSE; ++i) {
        double x = (double)i / DPH_COARSE, y[4];
        dph_parameter_at(x, y);
        while (segment < SEGMENTS - 1 && plan->length * y[0] > plan->segment_arc[segment + 1])
            ++segment;
        dph_path_point_at(plan, &w->bounds, segment, x, &w->coarse[i]);
    }
    profile_caps(w);
    dph_shares shares;
    density(w, &shares);
    dph_knots_lay(plan, &shares, INTERVALS, least_intervals, w);
    lay_basis(w);
    profile_erode(w->profile);
    w->best.stretch = 1.0;
    w->best.duration = HUGE_VAL;
}

int dph_profile_start(dph_workspace *w, int attempt)
{
    /* The crude profile has corners, which jerk does not like: of several degrees of smoothing the fastest; a constant b always works. */
    static const int passes[] = {2, 3, 5, 10, 20};
    static const int smooth = sizeof passes / sizeof *passes;
    size_t size = (size_t)(w->intervals + 1) * sizeof *w->b;
    if (attempt < smooth) {
        profile_smooth(w->profile, passes[attempt]); /* on top of the passes before: 2, 5, 10, 20, 40 */
        sample_profile(w, w->profile);
    } else {
        for (int k = 0; k <= w->intervals; ++k) {
            w->b[k] = 1.0;
            w->slope[k] = 0.0;
        }
    }
    double time = dph_profile_fit(w);
    if (time < w->best.duration) {
        w->best.duration = time;
        memcpy(w->best.b, w->b, size);
        memcpy(w->best.slope, w->slope, size);
    }
    if (attempt + 1 < smooth || !(w->best.duration < HUGE_VAL || attempt == smooth))
        return 0;
    memcpy(w->b, w->best.b, size);
    memcpy(w->slope, w->best.slope, size);
    w->unit = w->best.duration;
    for (int k = 0; k < w->intervals; ++k)
        for (int j = 0; j < DPH_NODES; ++j)
            w->node[k][j].weight /= w->unit;
    return 1;
}
