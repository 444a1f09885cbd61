/* The memory of planning, caller-owned: where it stands, and the time-optimal law's solver (time_optimal.h). It all lives on between slices. */
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
    double least_inverse_cap; /* of b, where nothing else bounds it [s^2] */
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

/* Where the laying of a path within limits stands (path_limits.c); zero where it begins. */
typedef struct dph_laying {
    int is_laid, unused;
    dph_cursor cursor;
} dph_laying;

/* Peaks of a plan (peaks.c). Channels: four of three joints each, then tcp speed and acceleration. */
enum { DPH_CHANNELS = 14, DPH_SCAN = 128 };

typedef struct dph_peak_search {
    int piece, channel, sample; /* of what comes next; channel -1: the scan of the piece */
    int unused;                 /* fills the gap before the doubles */
    double scan[DPH_SCAN + 1][DPH_CHANNELS];
    double greatest[DPH_CHANNELS]; /* of the scans */
    double peak[DPH_CHANNELS];
} dph_peak_search;

/* The search for the paper's three speeds (paper_limited.c). */
typedef struct dph_search {
    int stage, candidate, settling, unused; /* what comes next */
    dph_laying laying;
    dph_bounds bounds;
    double gravity;         /* greatest share of a torque limit that holding still takes */
    double shape[2][2];     /* the given one, the best one: logarithms of V_N / V_B, V_max / V_B */
    double centre[2], step[2];
    double least;           /* duration of the best one by samples [s] */
    double factor[2];       /* of both: V_B of the fastest plan [m/s] */
    double duration[2];     /* of both, settled [s] */
    dph_peak_search peaks;
} dph_search;

/* Where planning stands. */
typedef struct dph_progress {
    int has_law, unused;
    dph_cursor cursor;
    dph_search search;
} dph_progress;

/* A motion that keeps all limits once time is stretched, and its duration then [s]. */
typedef struct dph_candidate {
    double b[DPH_PIECES + 1], slope[DPH_PIECES + 1], stretch, duration;
} dph_candidate;

struct dph_workspace {
    dph_progress progress;
    /* Where the time-optimal law stands: stage and, in it, the next interval or attempt; runs of the solver so far, and its iterations. */
    int stage, next, runs, iteration;
    dph_laying laying;
    double excess[3];                                /* greatest of the intervals verified so far */
    double before, reduction;                        /* of the solver: duration before the last iteration, next reduction of the gap */
    dph_candidate best;
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
