/* What the corner and its motion law offer to the other files of the kernel only. */
#ifndef DELTAPH_CORNER_LAW_H
#define DELTAPH_CORNER_LAW_H

#include "kernel.h"

/* The leg m = k [m] that a deviation [m] needs, eq. (13). */
double dph_corner_leg(double deviation);

/* The preimage and its derivatives by gamma, [order], eq. (6). */
typedef struct dph_preimage {
    double u[3], v[3]; /* [m^(1/2)] */
} dph_preimage;

static inline dph_preimage preimage_at(const dph_corner *corner, double gamma)
{
    double a = corner->u0, b = corner->u2, r = 1.0 - gamma, v = b * gamma * gamma;
    dph_preimage p = {{a * r * r + v, 2.0 * (b * gamma - a * r), 2.0 * (a + b)}, {v, 2.0 * b * gamma, 2.0 * b}};
    return p;
}

/* Parametric speed sigma = u^2 + v^2 [m], eq. (18). */
static inline double corner_sigma(const dph_corner *corner, double gamma)
{
    double v = corner->u2 * gamma * gamma, u = corner->u0 * (1.0 - gamma) * (1.0 - gamma) + v;
    return u * u + v * v;
}

/* The same with its first two derivatives by gamma. */
static inline void corner_sigmas(const dph_preimage *p, double sigma[3])
{
    const double *u = p->u, *v = p->v;
    sigma[0] = u[0] * u[0] + v[0] * v[0];
    sigma[1] = 2.0 * (u[0] * u[1] + v[0] * v[1]);
    sigma[2] = 2.0 * (u[1] * u[1] + u[0] * u[2] + v[1] * v[1] + v[0] * v[2]);
}

/* The curve parameter at an arc length [m] from the corner's start. */
double dph_corner_gamma(const dph_corner *corner, double length);

/* Where a walk along a corner has got to. A zeroed one is at the beginning of a walk. */
typedef struct dph_corner_walk {
    double gamma, length;
    double pace[2]; /* first two derivatives of gamma by arc length there; 0 at the beginning of a walk */
} dph_corner_walk;

/* Position, tangent and curvature vector, in the corner's plane [order][x, y], at an arc length [m] from the corner's start: as
 * dph_corner_motion with unit speed, without the third derivative, and cheaper at the next one of many lengths in order. */
void dph_corner_frame(const dph_corner *corner, double length, dph_corner_walk *walk, double frame[3][2]);

/* Path speed v(gamma) [m/s], eq. (16). */
double dph_corner_speed(const dph_corner_law *law, double gamma);

/* The time t(gamma) from the corner's start [s], eq. (20), for gamma in [0, 1]. */
double dph_corner_law_time(const dph_corner_law *law, double gamma);

/* Position, velocity, acceleration, jerk in the corner's plane, [order][x, y], and arc length from the corner's start [m]. */
void dph_corner_law_motion(const dph_corner_law *law, double gamma, double motion[4][2], double *length);

/* The same for any path speed, given with its derivatives by gamma; {1, 0, 0} gives derivatives by arc length. */
void dph_corner_motion(const dph_corner *corner, double gamma, const double speed[3], double motion[4][2], double *length);

#endif
