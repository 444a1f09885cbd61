/* What the corner and its motion law offer to the other files of the kernel only. */
#ifndef DELTAPH_CORNER_LAW_H
#define DELTAPH_CORNER_LAW_H

#include "kernel.h"

/* The leg m = k [m] that a deviation [m] needs, eq. (13). */
double dph_corner_leg(double deviation);

/* Parametric speed sigma = u^2 + v^2 [m], eq. (18). */
double dph_corner_sigma(const dph_corner *corner, double gamma);

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

/* Position, velocity, acceleration, jerk in the corner's plane, [order][x, y], and arc length from the corner's start [m]. */
void dph_corner_law_motion(const dph_corner_law *law, double gamma, double motion[4][2], double *length);

/* The same for any path speed, given with its derivatives by gamma; {1, 0, 0} gives derivatives by arc length. */
void dph_corner_motion(const dph_corner *corner, double gamma, const double speed[3], double motion[4][2], double *length);

#endif
