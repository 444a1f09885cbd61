/* Motion law on a corner, phases 2 and 5: paper section 3.2, eqs. (15) to (28).
 *
 * The closed form (24) loses digits as V_N approaches V_B and is complex beyond it; the integral (20) that it evaluates is smooth there.
 * It is taken by quadrature for every V_N > 0, on panels as wide as the distance of the integrand's poles allows, from the nearest end of
 * a panel. */
#include "corner_law.h"

#include <math.h>

#include "quadrature.h"

/* Grades keep 2^-23 apart: finer is only asked for by V_N below 3e-14 V_B, where a corner takes days. */
static const double narrowest = 1.0 / 8388608.0;

/* A grade is integrated in so many pieces. Poles are half a grade away or more, eight half-lengths of a piece: the Bernstein ellipse of its
 * quadrature is 8 + sqrt(65) = 16, and 16^-12 = 3e-15 of what is the smaller part of the whole. */
enum { PIECES = 8 };

double dph_corner_speed(const dph_corner_law *law, double gamma)
{
    double dip = law->entry_speed - law->mid_speed;
    if (dip >= 0.0) {
        /* With w = 2 gamma - 1 eq. (16) is V_N + (V_B - V_N) w^2 (2 - w^2): nothing cancels in the middle, where V_N may be tiny. */
        double w = 2.0 * gamma - 1.0, w2 = w * w;
        return law->mid_speed + dip * w2 * (2.0 - w2);
    }
    double s = gamma * (1.0 - gamma);
    return law->entry_speed - 16.0 * dip * s * s;
}

/* The speed's derivatives by gamma. */
static void speed_slopes(const dph_corner_law *law, double gamma, double *first, double *second)
{
    double dip = law->entry_speed - law->mid_speed, s = gamma * (1.0 - gamma), s1 = 1.0 - 2.0 * gamma;
    *first = -32.0 * dip * s * s1;
    *second = -32.0 * dip * (s1 * s1 - 2.0 * s);
}

/* dt / dgamma, the integrand of eq. (20). */
static double slowness(double gamma, const void *context)
{
    const dph_corner_law *law = context;
    return corner_sigma(&law->corner, gamma) / dph_corner_speed(law, gamma);
}

/* Time from one parameter to another one in the same panel. */
static double time_between(const dph_corner_law *law, double from, double to)
{
    double share = 1.0 / law->pieces, length = (to - from) * share, sum = 0.0; /* a power of two: exact, and early */
    for (int piece = 0; piece < law->pieces; ++piece)
        sum += gauss_integral_6(slowness, law, from + length * piece, from + length * (piece + 1));
    return sum;
}

/* Ends of grades on [0, 1/2], growing by two away from the poles of 1/v, which lie at 1/2 +- i eta/2 for V_N < V_B (eta of eq. (23)), and
 * about i c away from both ends for V_N > V_B. The width next to a pole is twice its distance. */
static int half_grades(const dph_corner_law *law, double end[])
{
    double dip = law->entry_speed - law->mid_speed, pole = 0.5;
    if (dip > 0.0)
        pole = 0.5 * sqrt(law->mid_speed / (dip * (sqrt(law->entry_speed / dip) + 1.0))); /* eta / 2, without its cancellation */
    else if (dip < 0.0)
        pole = 0.25 * sqrt(law->entry_speed / -dip);

    double width = 2.0 * pole > narrowest ? 2.0 * pole : narrowest;
    double distance[DPH_PANELS / 2];
    int inner = 0;
    for (double at = width; at < 0.5; at *= 2.0)
        distance[inner++] = at;

    int n = 0;
    end[n++] = 0.0;
    for (int i = 0; i < inner; ++i)
        end[n++] = dip > 0.0 ? 0.5 - distance[inner - 1 - i] : distance[i];
    end[n] = 0.5;
    return n;
}

/* Taylor's series to third order of gamma(t) from where it is gamma, without that: dgamma/dt = v / sigma, eq. (17). */
static void series_at(const dph_corner_law *law, double gamma, double series[3])
{
    dph_preimage preimage = preimage_at(&law->corner, gamma);
    double sigma[3], v = dph_corner_speed(law, gamma), v1, v2;
    corner_sigmas(&preimage, sigma);
    speed_slopes(law, gamma, &v1, &v2);
    double inverse = 1.0 / sigma[0], g = v * inverse, g1 = (v1 - g * sigma[1]) * inverse;
    double g2 = (v2 - 2.0 * g1 * sigma[1] - g * sigma[2]) * inverse;
    series[0] = g;
    series[1] = g * g1 / 2.0;
    series[2] = g * (g2 * g + g1 * g1) * (1.0 / 6.0);
}

static inline double after(double gamma, const double series[3], double time)
{
    return gamma + time * (series[0] + time * (series[1] + time * series[2]));
}

void dph_corner_law_make(const dph_corner *corner, double entry_speed, double mid_speed, dph_corner_law *law)
{
    law->corner = *corner;
    law->entry_speed = entry_speed;
    law->mid_speed = mid_speed;

    /* A panel is a piece of a grade; where these would be more than there is room for, two, four or all eight of them. */
    double end[DPH_PANELS / 2 + 1];
    int grades = half_grades(law, end), parts = PIECES;
    while (parts > 1 && 2 * grades * parts > DPH_PANELS)
        parts /= 2;
    law->pieces = PIECES / parts;
    law->panels = 2 * grades * parts;
    for (int i = 0; i < grades * parts; ++i) {
        const double *grade = &end[i / parts];
        law->gamma[i] = grade[0] + (grade[1] - grade[0]) * (i % parts) / parts;
        law->gamma[law->panels - i] = 1.0 - law->gamma[i];
    }
    law->gamma[grades * parts] = 0.5;

    law->time[0] = 0.0;
    for (int i = 0; i < law->panels; ++i)
        law->time[i + 1] = law->time[i] + time_between(law, law->gamma[i], law->gamma[i + 1]);
    law->duration = law->time[law->panels];
    for (int i = 0; i <= law->panels; ++i)
        series_at(law, law->gamma[i], law->series[i]);
}

/* The panel that a value is in, by the ends of the panels. */
static int panel_of(const dph_corner_law *law, const double end[], double value)
{
    int low = 0, high = law->panels;
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (end[middle] <= value)
            low = middle;
        else
            high = middle;
    }
    return low;
}

double dph_corner_law_time(const dph_corner_law *law, double gamma)
{
    int panel = panel_of(law, law->gamma, gamma);
    return law->time[panel] + time_between(law, law->gamma[panel], gamma);
}

/* Newton's method (27) carried to third order: where t(gamma) is off, the series over what is missing. Returned: the number of steps. */
static int invert(const dph_corner_law *law, double time, double *gamma)
{
    int low = panel_of(law, law->time, time), high = low + 1, step = 0;
    double left = law->gamma[low], right = law->gamma[high], before;
    int nearest = time - law->time[low] < law->time[high] - time ? low : high;
    double from = law->gamma[nearest], since = time - law->time[nearest], next = after(from, law->series[nearest], since), series[3];

    /* From an error e a step leaves about (e / R)^4 R, R being the distance of the nearest singularity, four pieces or more: of a thousandth
     * of a piece, which is at most 1/16, a few 1e-16. The series from the nearest end is that good but next to a pole or in long panels. */
    do {
        before = next < left ? left : next > right ? right : next; /* t(gamma) increases: beyond the panel is too far */
        series_at(law, before, series);
        next = after(before, series, since - time_between(law, from, before));
    } while (++step < 20 && fabs(next - before) * law->pieces > 1e-3 * (right - left));
    *gamma = next;
    return step;
}

void dph_corner_law_gamma(const dph_corner_law *law, int n, const double *time, double *gamma, int *steps)
{
    for (int i = 0; i < n; ++i) {
        int count = 0;
        if (!(time[i] > 0.0))
            gamma[i] = 0.0;
        else if (!(time[i] < law->duration))
            gamma[i] = 1.0;
        else
            count = invert(law, time[i], &gamma[i]);
        if (steps)
            steps[i] = count;
    }
}

void dph_corner_law_motion(const dph_corner_law *law, double gamma, double motion[4][2], double *length)
{
    double speed[3] = {dph_corner_speed(law, gamma)};
    speed_slopes(law, gamma, &speed[1], &speed[2]);
    dph_corner_motion(&law->corner, gamma, speed, motion, length);
}

void dph_corner_motion(const dph_corner *corner, double gamma, const double speed[3], double motion[4][2], double *length)
{
    dph_corner_point point;
    dph_corner_at(corner, gamma, &point);

    /* g = v / sigma = dgamma/dt (eq. (17)) and its derivatives by gamma, from v = g sigma. */
    double inverse = 1.0 / point.sigma[0], g = speed[0] * inverse;
    double g1 = (speed[1] - g * point.sigma[1]) * inverse;
    double g2 = (speed[2] - 2.0 * g1 * point.sigma[1] - g * point.sigma[2]) * inverse;

    /* Time derivatives of gamma, then of the position by the chain rule. */
    double d1 = g, d2 = g1 * g, d3 = g2 * g * g + g1 * g1 * g;
    for (int i = 0; i < 2; ++i) {
        motion[0][i] = point.p[0][i];
        motion[1][i] = point.p[1][i] * d1;
        motion[2][i] = point.p[2][i] * d1 * d1 + point.p[1][i] * d2;
        motion[3][i] = point.p[3][i] * d1 * d1 * d1 + 3.0 * point.p[2][i] * d1 * d2 + point.p[1][i] * d3;
    }
    *length = point.length;
}
