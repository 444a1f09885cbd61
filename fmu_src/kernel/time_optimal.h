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

/* The first of it: the path is laid, the limits are read. */
dph_verdict dph_path_begin(dph_plan *plan, dph_bounds *bounds, dph_laying *laying, int *units);

/* What both laws within limits begin with, in slices: the path is laid, the limits are read, the robot can follow the path and hold still
 * everywhere on it; or a refusal. */
dph_verdict dph_path_lay(dph_plan *plan, dph_bounds *bounds, dph_laying *laying, int *units);

/* The path at a parameter x as seen from within a segment. The path has passed dph_path_check. Cost: a pose; three inverse dynamics more
 * where a torque is limited. */
void dph_path_point_at(const dph_plan *plan, const dph_bounds *bounds, int segment, double x, dph_path_point *point);

/* Greatest b by velocity limits, inverted [s^2]. */
double dph_inverse_cap(const dph_bounds *bounds, const dph_path_point *point);

/* The rows |c . (b, b', b'') + offset| <= 1 (acceleration, torque), then <= b^-1/2 (jerk). Returned: their numbers in count[2]. */
void dph_rows_at(const dph_bounds *bounds, const dph_path_point *point, double c[][3], double offset[], int count[2]);

/* ---- path_profile.c --------------------------------------------------------------------------------------------------------------- */

/* Lay knots where path and time ask for them. The path has passed dph_path_lay. Cost: 65 points. */
void dph_profile_begin(const dph_plan *plan, dph_workspace *w);

/* What the limits say in interval k. Cost: 13 points. */
void dph_profile_interval(const dph_plan *plan, dph_workspace *w, int k);

/* Try a strictly feasible b, b' at the knots, attempt 0, 1, ...; the fastest one is best. Returned: 1 after the last attempt: the workspace
 * then has the best one, and its duration as the unit of time. Cost: of dph_profile_fit. */
int dph_profile_start(dph_workspace *w, int attempt);

/* Shrink b to strict feasibility at the nodes by one factor. Returned: the duration then [s]; infinite where there is none. Cost: 0.2 us per
 * interval. */
double dph_profile_fit(dph_workspace *w);

/* How many of the knots, as a share, lie up to points of the path: rising from 0 to 1 at x from 0 to 1, linear in between. */
typedef struct dph_shares {
    int intervals;
    double at[DPH_COARSE + 1], share[DPH_COARSE + 1];
} dph_shares;

/* Lay knots: about so many intervals, at least so many in each segment of a side. */
void dph_knots_lay(const dph_plan *plan, const dph_shares *shares, int intervals, const int least[3], dph_workspace *w);

/* ---- reachability.c ------------------------------------------------------------------------------------------------------------------ */

/* Where only velocity and acceleration are limited: knots, and b, b' at them, in the workspace; path and limits are laid.
 * Returned: the factor by which time has to be stretched to keep the limits, 0 where no motion was found; is_clear: 1 where the robot can
 * follow the path beyond doubt, 0 where dph_path_lay is to find out. Cost: some 120 points, three passes to and fro. */
double dph_reachability(const dph_plan *plan, dph_workspace *w, int *is_clear);

/* ---- interior_point.c ------------------------------------------------------------------------------------------------------------- */

/* b and its derivatives by u at a point of an interval, x = knot + u width. */
void dph_hermite(const double value[2], const double slope[2], double u, double b[3]);

/* Is that b positive, and finite, in the whole interval? */
int dph_is_positive(const double value[2], const double slope[2]);

/* Begin to shorten the duration from a strictly feasible b in the workspace.
 * Given: first complementarity gap, relative to the duration. */
void dph_interior_point_begin(dph_workspace *w, double gap);

/* One iteration; each leaves a b in the workspace that is strictly feasible at the nodes.
 * Returned: 0 where there is nothing more to gain, since the gap is below `tolerance` of the duration or rounding has the upper hand; else 1.
 * Cost:     0.5 us per interval. */
int dph_interior_point_iterate(dph_workspace *w, double gap, double tolerance);

#endif
