/* Quintic Pythagorean-hodograph corner with equal legs: paper section 3.1. */
#include "corner_law.h"

#include <math.h>

/* d / m of eq. (13), in closed form; the paper prints 0.17064. */
static double deviation_per_leg(void)
{
    return (45.0 + sqrt(2.0)) / 272.0;
}

double dph_corner_leg(double deviation)
{
    return deviation / deviation_per_leg();
}

void dph_corner_from_deviation(double deviation, dph_corner *corner)
{
    corner->deviation = deviation;
    corner->leg = dph_corner_leg(deviation);
    /* Eq. (12) without its cancellation: u2^2 = 15 m / (6 + sqrt 2), u0^2 = 2 u2^2. */
    corner->u2 = sqrt(15.0 * corner->leg / (6.0 + sqrt(2.0)));
    corner->u0 = sqrt(2.0) * corner->u2;
    dph_corner_point end;
    dph_corner_at(corner, 1.0, &end);
    corner->length = end.length;
}

double dph_corner_sigma(const dph_corner *corner, double gamma)
{
    double v = corner->u2 * gamma * gamma;
    double u = corner->u0 * (1.0 - gamma) * (1.0 - gamma) + v;
    return u * u + v * v;
}

/* Arc length from the corner's start. */
static double length_at(const dph_corner *corner, double gamma)
{
    double a = corner->u0, b = corner->u2, r = 1.0 - gamma;
    double g3 = gamma * gamma * gamma, g5 = g3 * gamma * gamma;
    return a * a * (1.0 - r * r * r * r * r) / 5.0 + 2.0 * a * b * (g3 / 3.0 - g3 * gamma / 2.0 + g5 / 5.0) + 2.0 * b * b * g5 / 5.0;
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
        double step = -residual / dph_corner_sigma(corner, gamma);
        double next = gamma + step;
        gamma = next >= low && next <= high ? next : 0.5 * (low + high);
        if (fabs(step) < 1e-9)
            break;
    }
    return gamma;
}

void dph_corner_at(const dph_corner *corner, double gamma, dph_corner_point *point)
{
    double a = corner->u0, b = corner->u2, r = 1.0 - gamma;

    /* Preimage and its derivatives by gamma, eq. (6). */
    double v = b * gamma * gamma, v1 = 2.0 * b * gamma, v2 = 2.0 * b;
    double u = a * r * r + v, u1 = 2.0 * (b * gamma - a * r), u2 = 2.0 * (a + b);

    /* Integrals of u^2 - v^2, 2uv and u^2 + v^2, in terms that vanish with gamma one by one (eqs. (3), (4)). */
    double g3 = gamma * gamma * gamma, g5 = g3 * gamma * gamma;
    double first = a * a * (1.0 - r * r * r * r * r) / 5.0;
    double mixed = 2.0 * a * b * (g3 / 3.0 - g3 * gamma / 2.0 + g5 / 5.0);
    double last = 2.0 * b * b * g5 / 5.0;

    point->p[0][0] = mixed + last;
    point->p[0][1] = first + mixed;
    point->p[1][0] = 2.0 * u * v;
    point->p[1][1] = (u - v) * (u + v);
    point->p[2][0] = 2.0 * (u1 * v + u * v1);
    point->p[2][1] = 2.0 * (u * u1 - v * v1);
    point->p[3][0] = 2.0 * (u2 * v + 2.0 * u1 * v1 + u * v2);
    point->p[3][1] = 2.0 * (u1 * u1 + u * u2 - v1 * v1 - v * v2);

    point->sigma[0] = u * u + v * v;
    point->sigma[1] = 2.0 * (u * u1 + v * v1);
    point->sigma[2] = 2.0 * (u1 * u1 + u * u2 + v1 * v1 + v * v2);
    point->length = first + mixed + last;
}
