/* The memory of the time-optimal law's solver, caller-owned: see time_optimal.h. */
#ifndef DELTAPH_WORKSPACE_H
#define DELTAPH_WORKSPACE_H

#include "kernel.h"
#include "path.h"

enum {
    DPH_FINE = 12,     /* parts of an interval on which the limits are verified */
    DPH_REACH_FINE = 6,
    DPH_NODES = 5,     /* nodes of an interval at which the limits are constraints: u = 0, 1/4, 1/2, 3/4, 1 */
    DPH_ROWS = 9,      /* two-sided constraints of a node: acceleration, torque and jerk of three joints */
    DPH_COARSE = 64,   /* parts of the crude profile */
    DPH_UNKNOWNS = 2 * (DPH_PIECES + 1)
};

/* Limits as the solver wants them: inverted, 0 where there is none. */
typedef struct dph_bounds {
    double velocity[3], acceleration[3], jerk[3], torque[3], tcp_speed;
    int has_torque, has_jerk;
} dph_bounds;

/* The path at a parameter x: derivatives by x. */
typedef struct dph_path_point {
    double q[3][3];       /* q', q'', q''' of each joint: [order - 1][joint] [rad] */
    double ds;            /* s' [m] */
    double dynamic[2][3]; /* torque by b and by b' of each joint [N m s^2] */
    double gravity[3];    /* torque at rest [N m] */
} dph_path_point;

/* A two-sided constraint of a node and the multipliers of its sides. */
typedef struct dph_row {
    double c[3]; /* by b and its derivatives by u */
    double offset;
    double multiplier[2], inverse_slack[2], change[2];
} dph_row;

typedef struct dph_node {
    double weight; /* of the quadrature of T, over the unit of time */
    double cap;    /* 1 / greatest b [s^2]; 0 where the next interval has the same */
    double cap_multiplier, cap_inverse_slack, cap_change;
    double b, w;   /* b, b^-1/2 */
    int rows[2];   /* numbers of rows with a bound of 1 and of b^-1/2 */
    dph_row row[DPH_ROWS];
} dph_node;

/* A point as reachability.c sees it. */
typedef struct dph_reach_point {
    double q[2][3];    /* q', q'' of each joint: [order - 1][joint] [rad] */
    double ds;         /* ds/dx [m] */
} dph_reach_point;

struct dph_workspace {
    dph_bounds bounds;
    int intervals;
    int segment[DPH_PIECES];
    double knot[DPH_PIECES + 1];
    double inner[DPH_PIECES];                        /* where an interval's first point is seen: its knot, but inside its segment */
    double b[DPH_PIECES + 1], slope[DPH_PIECES + 1]; /* unknowns at the knots */
    double unit;                                     /* of time: duration of the start [s] */
    double basis[DPH_NODES][3][4];
    double tighten[DPH_PIECES][3];                   /* of velocity, of acceleration and torque, of jerk; 1 or more */
    dph_path_point point[DPH_PIECES][DPH_FINE + 1];
    dph_node node[DPH_PIECES][DPH_NODES];
    /* reachability.c */
    dph_reach_point reach[DPH_PIECES + 1][2];            /* at the knots and in the middles */
    double fine[DPH_PIECES][DPH_REACH_FINE + 1][2][3];   /* q', q'' where the limits are verified */
    double fine_ds[DPH_PIECES][DPH_REACH_FINE + 1];      /* ds/dx there, over the limit of the tcp speed */
    double row[DPH_PIECES][2][3];                        /* at the knots, of each joint's acceleration by b and b' */
    double bend[DPH_PIECES][3], cap[DPH_PIECES];         /* by b in the middles; greatest b there */
    double matrix[DPH_UNKNOWNS][4];                  /* lower band: [i][k] is element (i, i - k) */
    double objective[DPH_UNKNOWNS], barrier[DPH_UNKNOWNS], step[DPH_UNKNOWNS];
    dph_path_point coarse[DPH_COARSE + 1];
    double profile[DPH_COARSE + 1];
};

#endif
