/* Quintic Pythagorean-hodograph corner: paper section 3.1, for legs of any two lengths m and k. */
#include "corner_law.h"

#include <math.h>

/* d / m of eq. (13) for m = k, in closed form; the paper prints 0.17064. */
static double deviation_per_leg(void)
{
    return (45.0 + sqrt(2.0)) / 272.0;
}

double dph_corner_leg(double deviation)
{
    return deviation / deviation_per_leg();
}

/* The preimage that ends at (k, m) with a horizontal tangent, paper section 3.1, without its cancellations:
 * u0^2 = 180 m^2 / (35 m + k + S), u2^2 = 90 k^2 / (m + 35 k + S), S^2 = m^2 + k^2 + 70 m k; m = k gives eq. (12). */
static void lay(double m, double k, dph_corner *corner)
{
    double S = sqrt(m * m + k * k + 70.0 * m * k);
    corner->leg = m;
    corner->second_leg = k;
    corner->u0 = m * sqrt(180.0 / (35.0 * m + k + S));
    corner->u2 = k * sqrt(90.0 / (m + 35.0 * k + S));
    dph_corner_point end;
    dph_corner_at(corner, 1.0, &end);
    corner->length = end.length;
}

/* Distance of the vertex H from the curve, which is not at gamma = 1/2 where m != k: the foot point is the root of (P - H) . P', which is
 * -m u0^2 at gamma = 0 and 2 k u2^2 at 1. Newton's method within a shrinking bracket; the distance is stationary there, so that a step
 * below 1e-9 leaves nothing to gain. */
static double vertex_distance(const dph_corner *corner)
{
    double low = 0.0, high = 1.0, gamma = 0.5, x = 0.0, y = 0.0;
    for (int i = 0; i < 60; ++i) {
        dph_corner_point point;
        dph_corner_at(corner, gamma, &point);
        x = point.p[0][0];
        y = point.p[0][1] - corner->leg;
        double slope = x * point.p[1][0] + y * point.p[1][1];
        double bend = point.sigma[0] * point.sigma[0] + x * point.p[2][0] + y * point.p[2][1];
        if (slope > 0.0)
            high = gamma;
        else
            low = gamma;
        double next = gamma - slope / bend;
        next = next >= low && next <= high ? next : 0.5 * (low + high);
        if (fabs(next - gamma) < 1e-9)
            break;
        gamma = next;
    }
    return sqrt(x * x + y * y);
}

void dph_corner_from_deviation(double deviation, dph_corner *corner)
{
    lay(dph_corner_leg(deviation), dph_corner_leg(deviation), corner);
    corner->deviation = deviation;
}

void dph_corner_from_legs(double leg, double second_leg, dph_corner *corner)
{
    lay(leg, second_leg, corner);
    corner->deviation = vertex_distance(corner);
}

double dph_corner_longer_leg(double leg, double deviation, double most)
{
    /* d / m = f(k / m), near to (d / m)_(m = k) sqrt(k / m). The logarithm of f rises with that of k / m, by a slope within (0, 1), since
     * f(1 / r) = f(r) / r; a correction by the square is therefore a contraction, and a fast one: its factor is |1 - 2 slope|. */
    dph_corner corner;
    dph_corner_from_legs(leg, most, &corner);
    if (corner.deviation <= deviation)
        return most;
    double first = dph_corner_leg(deviation) / leg, longer = leg * first * first;
    for (int i = 0; i < 60; ++i) {
        dph_corner_from_legs(leg, longer, &corner);
        double ratio = deviation / corner.deviation;
        longer *= ratio * ratio;
        if (fabs(ratio - 1.0) < 4e-16)
            break;
    }
    return longer;
}

/* Arc length from the corner's start. */
static double length_at(const dph_corner *corner, double gamma)
{
    double a = corner->u0, b = corner->u2, r = 1.0 - gamma;
    double g3 = gamma * gamma * gamma, g5 = g3 * gamma * gamma;
    return 0.2 * a * a * (1.0 - r * r * r * r * r) + 2.0 * a * b * (g3 * (1.0 / 3.0) - g3 * gamma * 0.5 + g5 * 0.2) + 0.4 * b * b * g5;
}

double dph_corner_gamma(const dph_corner *corner, double length)
{
    if (!(length > 0.0))
        return 0.0;
    if (!(length < corner->length))
        return 1.0;
    /* Newton's method within a shrinking bracket: the length increases. A step below 1e-9 leaves an error of about its square. */
    double low = 0.0, high = 1.0, gamma = length / corner->length;
    for (int i = 0; i < 60; ++i) {
        double residual = length_at(corner, gamma) - length;
        if (residual > 0.0)
            high = gamma;
        else
            low = gamma;
        double step = -residual / corner_sigma(corner, gamma);
        double next = gamma + step;
        gamma = next >= low && next <= high ? next : 0.5 * (low + high);
        if (fabs(step) < 1e-9)
            break;
    }
    return gamma;
}

void dph_corner_frame(const dph_corner *corner, double length, dph_corner_walk *walk, double frame[3][2])
{
    double ahead = length - walk->length, a = corner->u0, b = corner->u2;
    double gamma = walk->gamma + ahead * (walk->pace[0] + 0.5 * ahead * walk->pace[1]);
    if (!(walk->pace[0] > 0.0) || !(gamma >= 0.0) || !(gamma <= 1.0))
        gamma = dph_corner_gamma(corner, length);
    for (int i = 0;; ++i) {
        /* As in dph_corner_at. Along the curve the tangent is (2uv, u^2 - v^2) / sigma, turning by 2 (u'v - uv') / sigma^2. */
        double r = 1.0 - gamma, r2 = r * r, g2 = gamma * gamma, g3 = g2 * gamma, g5 = g3 * g2;
        double v = b * g2, v1 = 2.0 * b * gamma, u = a * r2 + v, u1 = v1 - 2.0 * a * r;
        double first = a * a * (1.0 - r2 * r2 * r) * 0.2, mixed = 2.0 * a * b * (g3 * (1.0 / 3.0) - g3 * gamma * 0.5 + g5 * 0.2);
        double last = 0.4 * b * b * g5, inverse = 1.0 / (u * u + v * v);
        double step = (length - (first + mixed + last)) * inverse;
        /* Newton's method: a step below 1e-8 leaves an error of about its square. */
        if (fabs(step) < 1e-8 || i == 4) {
            double turn = 2.0 * (u * v1 - u1 * v) * inverse * inverse;
            frame[1][0] = 2.0 * u * v * inverse;
            frame[1][1] = (u - v) * (u + v) * inverse;
            frame[0][0] = mixed + last;
            frame[0][1] = first + mixed;
            frame[2][0] = turn * frame[1][1];
            frame[2][1] = -turn * frame[1][0];
            walk->gamma = gamma;
            walk->length = length;
            walk->pace[0] = inverse;
            walk->pace[1] = -2.0 * (u * u1 + v * v1) * inverse * inverse * inverse;
            return;
        }
        gamma = i == 3 ? dph_corner_gamma(corner, length) : gamma + step;
    }
}

void dph_corner_at(const dph_corner *corner, double gamma, dph_corner_point *point)
{
    double a = corner->u0, b = corner->u2, r = 1.0 - gamma;
    dph_preimage preimage = preimage_at(corner, gamma);
    const double *u = preimage.u, *v = preimage.v;

    /* Integrals of u^2 - v^2, 2uv and u^2 + v^2, in terms that vanish with gamma one by one (eqs. (3), (4)). */
    double g3 = gamma * gamma * gamma, g5 = g3 * gamma * gamma;
    double first = 0.2 * a * a * (1.0 - r * r * r * r * r);
    double mixed = 2.0 * a * b * (g3 * (1.0 / 3.0) - g3 * gamma * 0.5 + g5 * 0.2);
    double last = 0.4 * b * b * g5;

    point->p[0][0] = mixed + last;
    point->p[0][1] = first + mixed;
    point->p[1][0] = 2.0 * u[0] * v[0];
    point->p[1][1] = (u[0] - v[0]) * (u[0] + v[0]);
    point->p[2][0] = 2.0 * (u[1] * v[0] + u[0] * v[1]);
    point->p[2][1] = 2.0 * (u[0] * u[1] - v[0] * v[1]);
    point->p[3][0] = 2.0 * (u[2] * v[0] + 2.0 * u[1] * v[1] + u[0] * v[2]);
    point->p[3][1] = 2.0 * (u[1] * u[1] + u[0] * u[2] - v[1] * v[1] - v[0] * v[2]);
    corner_sigmas(&preimage, point->sigma);
    point->length = first + mixed + last;
}
