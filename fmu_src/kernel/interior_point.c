/* Feasible primal-dual interior-point method for the time-optimal law: minimize T(b) = int b^-1/2 dx under slacks s(b) > 0 at the nodes,
 *   1 - cap b,   1 -+ (c . (b, b', b'') + offset),   b^-1/2 -+ c . (b, b', b'').
 * The last one, jerk, is not concave; but b^-1/2 is convex, so that a slack is never less than its linearisation: a step that keeps the
 * linearised slacks positive keeps the true ones so, and every iterate is a motion that can be run. With multipliers m and s m = mu a
 * Newton step d solves
 *   (T'' - sum m s'' + sum (m/s) s' s'^T) d = -T' + mu sum s'/s,
 * a band matrix of half width 3: an interval's nodes see b, b' at its two knots. */
#include <math.h>
#include <string.h>

#include "time_optimal.h"

/* Share of the way to the boundary that a step goes. */
static const double to_the_boundary = 0.98;

/* A duration that still shrinks by this share: from a poor start the gap may close before the optimum is near. Then it is opened again. */
static const double still_moving = 0.01;

/* Iterations at the beginning that use the convex part of the Hessian only. */
enum { CONVEX_ITERATIONS = 8 };

void dph_hermite(const double value[2], const double slope[2], double u, double b[3])
{
    /* Bernstein-like form in r = 1 - u: both ends exact. slope: by u. */
    double r = 1.0 - u, rise = value[1] - value[0];
    b[0] = value[0] * r * r * (1.0 + 2.0 * u) + value[1] * u * u * (3.0 - 2.0 * u) + slope[0] * u * r * r - slope[1] * u * u * r;
    b[1] = 6.0 * rise * u * r + slope[0] * r * (1.0 - 3.0 * u) + slope[1] * u * (3.0 * u - 2.0);
    b[2] = 6.0 * rise * (1.0 - 2.0 * u) + slope[0] * (6.0 * u - 4.0) + slope[1] * (6.0 * u - 2.0);
}

int dph_is_positive(const double value[2], const double slope[2])
{
    double scale = value[0] + value[1] + fabs(slope[0]) + fabs(slope[1]);
    if (!(value[0] > 0.0 && value[1] > 0.0 && scale < HUGE_VAL))
        return 0;
    if (value[0] + slope[0] / 3.0 > 0.0 && value[1] - slope[1] / 3.0 > 0.0) /* Bezier's control points: the cubic is among them */
        return 1;
    /* b' = slope[0] + 2 c u + 3 d u^2; b has its only minimum where b' rises. Of its value some 1e-15 of the scale may be rounding. */
    double rise = value[1] - value[0], c = 3.0 * rise - 2.0 * slope[0] - slope[1], d = slope[0] + slope[1] - 2.0 * rise;
    double root2 = c * c - 3.0 * d * slope[0], b[3];
    if (root2 <= 0.0)
        return 1; /* nowhere between its ends */
    double root = sqrt(root2), u = c > 0.0 ? -slope[0] / (c + root) : (root - c) / (3.0 * d);
    if (!(u > 0.0 && u < 1.0))
        return 1;
    dph_hermite(value, slope, u, b);
    return b[0] > 1e-14 * scale;
}

/* b, db/du, d2b/du2 at a node from four unknowns of its interval, slopes by u. */
static inline void node_value(const double basis[3][4], const double y[4], double v[3])
{
    for (int order = 0; order < 3; ++order)
        v[order] = basis[order][0] * y[0] + basis[order][1] * y[1] + basis[order][2] * y[2] + basis[order][3] * y[3];
}

static inline double row_value(const dph_row *row, const double v[3])
{
    return row->c[0] * v[0] + row->c[1] * v[1] + row->c[2] * v[2];
}

static void interval_unknowns(const dph_workspace *w, int k, const double *b, const double *slope, int stride, double y[4])
{
    double width = w->knot[k + 1] - w->knot[k];
    y[0] = b[0];
    y[1] = width * slope[0];
    y[2] = b[stride];
    y[3] = width * slope[stride];
}

/* Slacks at the present b, inverted. Returned: sum of slack times multiplier, its number of terms, and T. */
static double measure(dph_workspace *w, int *terms, double *duration)
{
    double gap = 0.0;
    *terms = 0;
    *duration = 0.0;
    for (int k = 0; k < w->intervals; ++k) {
        double y[4], v[3];
        interval_unknowns(w, k, &w->b[k], &w->slope[k], 1, y);
        for (int j = 0; j < DPH_NODES; ++j) {
            dph_node *node = &w->node[k][j];
            node_value((const double(*)[4])w->basis[j], y, v);
            node->b = v[0];
            node->w = 1.0 / sqrt(v[0]);
            *duration += node->weight * node->w;
            if (node->cap > 0.0) {
                double slack = 1.0 - node->cap * v[0];
                node->cap_inverse_slack = 1.0 / slack;
                gap += slack * node->cap_multiplier;
                *terms += 1;
            }
            int rows = node->rows[0] + node->rows[1];
            for (int i = 0; i < rows; ++i) {
                dph_row *row = &node->row[i];
                double x = row_value(row, v) + row->offset, bound = i < node->rows[0] ? 1.0 : node->w;
                double upper = bound - x, lower = bound + x, inverse = 1.0 / (upper * lower);
                row->inverse_slack[0] = lower * inverse;
                row->inverse_slack[1] = upper * inverse;
                gap += upper * row->multiplier[0] + lower * row->multiplier[1];
            }
            *terms += 2 * rows;
        }
    }
    return gap;
}

/* A node's share of matrix (by b, b', b'' of u: 00, 10, 11, 20, 21, 22), objective and barrier gradient. */
static void node_terms(const dph_node *node, int convex, double m[6], double f[3], double g[3])
{
    double w1 = -0.5 * node->w / node->b, w2 = -1.5 * w1 / node->b; /* derivatives of b^-1/2 */
    double curvature = node->weight;
    memset(m, 0, 6 * sizeof *m);
    memset(f, 0, 3 * sizeof *f);
    memset(g, 0, 3 * sizeof *g);
    f[0] = -node->weight * w1;
    if (node->cap > 0.0) {
        double gradient = node->cap * node->cap_inverse_slack;
        m[0] += node->cap_multiplier * node->cap * gradient;
        g[0] -= gradient;
    }
    const dph_row *row = node->row;
    for (int i = 0; i < node->rows[0]; ++i, ++row) {
        double c0 = row->c[0], c1 = row->c[1];
        double p = row->multiplier[0] * row->inverse_slack[0] + row->multiplier[1] * row->inverse_slack[1];
        double e = row->inverse_slack[1] - row->inverse_slack[0];
        m[0] += p * c0 * c0;
        m[1] += p * c0 * c1;
        m[2] += p * c1 * c1;
        g[0] += e * c0;
        g[1] += e * c1;
    }
    for (int i = 0; i < node->rows[1]; ++i, ++row) {
        double c0 = row->c[0], c1 = row->c[1], c2 = row->c[2], down = w1 - c0, up = w1 + c0;
        double a0 = row->multiplier[0] * row->inverse_slack[0], a1 = row->multiplier[1] * row->inverse_slack[1];
        double p = a0 + a1, mixed = a1 * up - a0 * down, e = row->inverse_slack[1] - row->inverse_slack[0];
        m[0] += a0 * down * down + a1 * up * up;
        m[1] += mixed * c1;
        m[2] += p * c1 * c1;
        m[3] += mixed * c2;
        m[4] += p * c1 * c2;
        m[5] += p * c2 * c2;
        g[0] += row->inverse_slack[0] * down + row->inverse_slack[1] * up;
        g[1] += e * c1;
        g[2] += e * c2;
        curvature -= row->multiplier[0] + row->multiplier[1];
    }
    if (curvature > 0.0 || !convex)
        m[0] += curvature * w2;
}

static void assemble(dph_workspace *w, int convex)
{
    int unknowns = 2 * (w->intervals + 1);
    memset(w->matrix, 0, (size_t)unknowns * sizeof *w->matrix);
    memset(w->objective, 0, (size_t)unknowns * sizeof *w->objective);
    memset(w->barrier, 0, (size_t)unknowns * sizeof *w->barrier);
    for (int k = 0; k < w->intervals; ++k) {
        double local[4][4] = {{0.0}}, width = w->knot[k + 1] - w->knot[k];
        const double scale[4] = {1.0, width, 1.0, width};
        double *objective = &w->objective[2 * k], *barrier = &w->barrier[2 * k];
        for (int j = 0; j < DPH_NODES; ++j) {
            const double(*basis)[4] = (const double(*)[4])w->basis[j];
            double m[6], f[3], g[3];
            node_terms(&w->node[k][j], convex, m, f, g);
            for (int a = 0; a < 4; ++a) {
                double x0 = basis[0][a], x1 = basis[1][a], x2 = basis[2][a];
                double t0 = m[0] * x0 + m[1] * x1 + m[3] * x2, t1 = m[1] * x0 + m[2] * x1 + m[4] * x2;
                double t2 = m[3] * x0 + m[4] * x1 + m[5] * x2;
                for (int b = 0; b <= a; ++b)
                    local[a][b] += t0 * basis[0][b] + t1 * basis[1][b] + t2 * basis[2][b];
                objective[a] += scale[a] * (f[0] * x0);
                barrier[a] += scale[a] * (g[0] * x0 + g[1] * x1 + g[2] * x2);
            }
        }
        for (int a = 0; a < 4; ++a)
            for (int b = 0; b <= a; ++b)
                w->matrix[2 * k + a][a - b] += scale[a] * scale[b] * local[a][b];
    }
}

/* L D L^T in place: [i][0] becomes the pivot, [i][k] element (i, i-k) of L. A pivot lost to rounding freezes its unknown. Returns 0 where
 * the matrix is not positive definite. */
static int factorize(dph_workspace *w)
{
    int unknowns = 2 * (w->intervals + 1), definite = 1;
    double(*a)[4] = w->matrix;
    for (int i = 0; i < unknowns; ++i) {
        double diagonal = a[i][0], c[4] = {0.0};
        for (int k = i < 3 ? i : 3; k > 0; --k) { /* c[k] = L D, column i - k */
            c[k] = a[i][k];
            for (int l = k + 1; l <= 3 && l <= i; ++l)
                c[k] -= c[l] * (l - k <= 3 ? a[i - k][l - k] : 0.0);
        }
        for (int k = 1; k <= 3 && k <= i; ++k) {
            a[i][k] = c[k] / a[i - k][0];
            a[i][0] -= c[k] * a[i][k];
        }
        if (!(a[i][0] > 0.0))
            definite = 0;
        if (!(a[i][0] > 1e-14 * diagonal))
            a[i][0] = HUGE_VAL;
    }
    return definite;
}

static void solve(const dph_workspace *w, double x[])
{
    int unknowns = 2 * (w->intervals + 1);
    const double(*a)[4] = (const double(*)[4])w->matrix;
    for (int i = 0; i < unknowns; ++i)
        for (int k = 1; k <= 3 && k <= i; ++k)
            x[i] -= a[i][k] * x[i - k];
    for (int i = 0; i < unknowns; ++i)
        x[i] /= a[i][0];
    for (int i = unknowns - 1; i >= 0; --i)
        for (int k = 1; k <= 3 && i + k < unknowns; ++k)
            x[i] -= a[i + k][k] * x[i + k];
}

/* Change of a multiplier where its slack changes by `ds`, and how far slack and multiplier allow to go. */
static inline double change_of(double mu, double multiplier, double inverse_slack, double ds, double limit[2])
{
    double relative = ds * inverse_slack, change = mu * inverse_slack - multiplier - multiplier * relative;
    if (1.0 + limit[0] * relative < 0.0)
        limit[0] = -1.0 / relative;
    if (multiplier + limit[1] * change < 0.0)
        limit[1] = -multiplier / change;
    return change;
}

/* Changes of the multipliers. Returned: greatest steps of b and of the multipliers. */
static void follow(dph_workspace *w, double mu, double limit[2])
{
    limit[0] = limit[1] = 1.0 / to_the_boundary;
    for (int k = 0; k < w->intervals; ++k) {
        double y[4], d[3];
        interval_unknowns(w, k, &w->step[2 * k], &w->step[2 * k + 1], 2, y);
        for (int j = 0; j < DPH_NODES; ++j) {
            dph_node *node = &w->node[k][j];
            node_value((const double(*)[4])w->basis[j], y, d);
            double w1 = -0.5 * node->w / node->b;
            if (0.9 * node->b + limit[0] * d[0] < 0.0) /* b itself stays positive */
                limit[0] = -0.9 * node->b / d[0];
            if (node->cap > 0.0)
                node->cap_change = change_of(mu, node->cap_multiplier, node->cap_inverse_slack, -node->cap * d[0], limit);
            int rows = node->rows[0] + node->rows[1];
            for (int i = 0; i < rows; ++i) {
                dph_row *row = &node->row[i];
                double dx = row_value(row, d), bound = i < node->rows[0] ? 0.0 : w1 * d[0];
                row->change[0] = change_of(mu, row->multiplier[0], row->inverse_slack[0], bound - dx, limit);
                row->change[1] = change_of(mu, row->multiplier[1], row->inverse_slack[1], bound + dx, limit);
            }
        }
    }
    limit[0] *= to_the_boundary;
    limit[1] *= to_the_boundary;
}

static void advance(dph_workspace *w, const double length[2])
{
    for (int k = 0; k <= w->intervals; ++k) {
        w->b[k] += length[0] * w->step[2 * k];
        w->slope[k] += length[0] * w->step[2 * k + 1];
    }
    for (int k = 0; k < w->intervals; ++k)
        for (int j = 0; j < DPH_NODES; ++j) {
            dph_node *node = &w->node[k][j];
            node->cap_multiplier += length[1] * node->cap_change;
            for (int i = 0; i < node->rows[0] + node->rows[1]; ++i)
                for (int side = 0; side < 2; ++side)
                    node->row[i].multiplier[side] += length[1] * node->row[i].change[side];
        }
}

/* Multipliers on the central path: slack times multiplier is mu everywhere. */
static void centre(dph_workspace *w, double mu)
{
    for (int k = 0; k < w->intervals; ++k)
        for (int j = 0; j < DPH_NODES; ++j) {
            dph_node *node = &w->node[k][j];
            node->cap_multiplier = node->cap > 0.0 ? mu * node->cap_inverse_slack : 0.0;
            node->cap_change = 0.0;
            for (int i = 0; i < node->rows[0] + node->rows[1]; ++i)
                for (int side = 0; side < 2; ++side)
                    node->row[i].multiplier[side] = mu * node->row[i].inverse_slack[side];
        }
}

void dph_interior_point_begin(dph_workspace *w, double first_gap)
{
    int terms;
    double duration;
    (void)measure(w, &terms, &duration);
    centre(w, first_gap * duration / terms);
    w->iteration = 0;
    w->before = HUGE_VAL;
    w->reduction = 0.5;
}

int dph_interior_point_iterate(dph_workspace *w, double first_gap, double tolerance)
{
    int terms, unknowns = 2 * (w->intervals + 1);
    double duration, length[2], gap = measure(w, &terms, &duration);
    if (gap < tolerance * duration) {
        if (w->before - duration < still_moving * duration)
            return 0;
        centre(w, first_gap * duration / terms);
        gap = first_gap * duration;
    }
    w->before = duration;
    double mu = w->reduction * gap / terms;
    assemble(w, w->iteration < CONVEX_ITERATIONS);
    if (!factorize(w)) {
        assemble(w, 1);
        (void)factorize(w);
    }
    for (int i = 0; i < unknowns; ++i)
        w->step[i] = w->objective[i] + mu * w->barrier[i];
    solve(w, w->step);
    follow(w, mu, length);
    if (!isfinite(length[0]) || !isfinite(length[1]))
        return 0;
    advance(w, length);
    double shorter = length[0] < length[1] ? length[0] : length[1], rest = 1.0 - shorter;
    w->reduction = rest * rest * rest;
    w->reduction = w->reduction < 0.03 ? 0.03 : w->reduction > 0.9 ? 0.9 : w->reduction;
    w->iteration += 1;
    return 1;
}
