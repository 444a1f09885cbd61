/* The path of a PPO by arc length: what its files offer to the other files of the kernel only. */
#ifndef DELTAPH_PATH_H
#define DELTAPH_PATH_H

#include "corner_law.h"
#include "kernel.h"

/* Segments of a path: lift, corner, half of the traverse, and the same from the place point. */
enum { SEGMENTS = 6 };

extern const dph_phase dph_segment_phase[SEGMENTS];

/* Lay the path of a plan whose task is finite and positive and whose direction and traverse are known: both sides without their motion,
 * segment_arc, length, corner_deviation; or refuse. */
dph_verdict dph_path_make(dph_plan *plan);

/* Where the check of a path stands: at what parameter, in which piece; zero where it begins. */
typedef struct dph_cursor {
    double at;
    int piece, unused; /* fills the gap after it */
} dph_cursor;

/* Can the robot follow a path that is laid (path_check.c)? Of the comparison law, whose path comes with its motion: once that is made.
 * Fails: UNREACHABLE, JOINT_RANGE or SINGULAR, with the phase; PLANNING where units have run out first. Cost: a unit per pose, one wherever
 * the last one vouches for no more of the path: some ten in the middle of the workspace, at most a million. */
dph_verdict dph_path_check(const dph_plan *plan, dph_cursor *cursor, int *units);

/* The path at an arc length from its nearer end, the pick point for segments 0 to 2, the place point for segments 3 to 5.
 * Returned: position, relative to that end, and derivatives by the arc length from the pick point, [order][horizontal, vertical]. */
void dph_path_at(const dph_plan *plan, int segment, double length, double d[4][2]);

/* Add to `d` what lies `s` along the stretch between the corners, as seen from the pick point or, mirrored, from the place point: s and its
 * derivatives [order]; d [order][horizontal, vertical]. */
void dph_path_along(const dph_plan *plan, int place, const double s[4], double d[4][2]);

/* A segment that `length` from the nearer end lies in: `segment` itself if possible, else a neighbour of it on the same side; none
 * without length, unless the side has no other. */
int dph_path_segment(const dph_plan *plan, int segment, double length);

/* The path parameter x in [0, 1] of the time-optimal law: s = L y(x), y = 10 x^3 - 15 x^4 + 6 x^5. At rest y' = y'' = 0, so that a start
 * with limited jerk, s ~ t^3, is x ~ t: regular. */

/* y and its derivatives, [order]. */
void dph_parameter_at(double x, double y[4]);

/* The x in [0, 1] with y(x) = `share`. */
double dph_parameter_of(double share);

/* Position and first two derivatives by x of the path, as dph_path_by_parameter, cheaper at the next one of many points in order.
 * Given: the walk, zeroed before the first point of each segment. Returned besides: the arc length from the nearer end [m]. */
void dph_path_walk(const dph_plan *plan, int segment, double x, dph_corner_walk *walk, double d[3][2], double *ds, double *length);

/* Derivatives by x of the path, [order][horizontal, vertical], position relative to the nearer end as in dph_path_at.
 * Returned besides: ds/dx [m]; the arc length from the pick point [m]. */
void dph_path_by_parameter(const dph_plan *plan, int segment, double x, double d[4][2], double *ds, double *arc_length);

#endif
