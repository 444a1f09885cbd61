/* The time-optimal law's inside: what its files share.
 *
 * Unknown is b(x) = (dx/dt)^2 of the path parameter x (path.h), a C1 piecewise cubic on knots. With ' = d/dx, for every joint
 *   velocity q' sqrt(b),  acceleration q'' b + q' b'/2,  jerk sqrt(b) (q''' b + 3/2 q'' b' + 1/2 q' b''),
 *   torque c b + m b' + g (inertia, centrifugal and Coriolis terms, gravity),
 * and T = int b^-1/2 dx is to be least.
 *
 * workspace.h: the memory. path_limits.c: what the limits say along the path. path_profile.c: a crude b, knots, start of the solver.
 * interior_point.c: the solver. reachability.c: the solver where only velocity and acceleration are limited. time_optimal.c: the law. */
#ifndef DELTAPH_TIME_OPTIMAL_H
#define DELTAPH_TIME_OPTIMAL_H

#include "workspace.h"

/* ---- path_limits.c ---------------------------------------------------------------------------------------------------------------- */

/* Read the limits: which rows there are. Returns OK, INVALID_VALUE, NO_LIMIT or TOO_SLOW. */
dph_verdict dph_limits_make(const dph_limits *limits, dph_bounds *bounds);

/* The path at a parameter x as seen from within a segment. The path has passed dph_path_check. Cost: a pose; three inverse dynamics more
 * where a torque is limited. */
void dph_path_point_at(const dph_plan *plan, const dph_bounds *bounds, int segment, double x, dph_path_point *point);

/* Can gravity be held everywhere on the path? OK, or LIMIT_EXCEEDED with phase and joint. Cost: some 60 inverse dynamics where a torque is
 * limited. */
dph_verdict dph_path_gravity_check(const dph_plan *plan, const dph_bounds *bounds);

/* 1 / greatest b of all [s^2]. */
extern const double dph_least_inverse_cap;

/* Greatest b by velocity limits, inverted [s^2]. */
double dph_inverse_cap(const dph_bounds *bounds, const dph_path_point *point);

/* The rows |c . (b, b', b'') + offset| <= 1 (acceleration, torque), then <= b^-1/2 (jerk). Returned: their numbers in count[2]. */
void dph_rows_at(const dph_bounds *bounds, const dph_path_point *point, double c[][3], double offset[], int count[2]);

/* ---- path_profile.c --------------------------------------------------------------------------------------------------------------- */

/* Lay knots where path and time ask for them, and a strictly feasible b, b' at them. The path has passed dph_path_check and
 * dph_path_gravity_check. */
void dph_profile_make(const dph_plan *plan, dph_workspace *w);

/* Shrink b to strict feasibility at the nodes by one factor. Returned: the duration then [s]; infinite where there is none. */
double dph_profile_fit(dph_workspace *w);

/* How many of the knots, as a share, lie up to points of the path: rising from 0 to 1 at x from 0 to 1, linear in between. */
typedef struct dph_shares {
    int intervals;
    double at[DPH_COARSE + 1], share[DPH_COARSE + 1];
} dph_shares;

/* Lay knots: about so many intervals, at least so many in each segment of a side. */
void dph_knots_lay(const dph_plan *plan, const dph_shares *shares, int intervals, const int least[3], dph_workspace *w);

/* ---- reachability.c ------------------------------------------------------------------------------------------------------------------ */

/* Limits of velocity and acceleration only: knots, b and b' in the workspace, on a path that dph_path_check has not seen.
 * Returned: OK, or the refusal of dph_path_check; the factor by which time has to be stretched to keep the limits, 0 where no motion was
 * found. Cost: some 150 points of the path, three passes to and fro. */
dph_verdict dph_reachability(const dph_plan *plan, dph_workspace *w, double *stretch);

/* ---- interior_point.c ------------------------------------------------------------------------------------------------------------- */

/* b and its derivatives by u at a point of an interval, x = knot + u width. */
void dph_hermite(const double value[2], const double slope[2], double u, double b[3]);

/* Shorten the duration from a strictly feasible b in the workspace; every iterate is strictly feasible at the nodes.
 * Given: greatest number of iterations; first complementarity gap, relative to the duration.
 * Returned: 1 where the gap came below `tolerance` of the duration, else 0; the workspace holds the last iterate either way. */
int dph_interior_point(dph_workspace *w, int iterations, double gap, double tolerance);

#endif
