/* deltaph kernel: pick-and-place operations (PPO) of a Delta robot on quintic Pythagorean-hodograph corners.
 *
 * What it is: the planner, the robot's kinematics and its rigid-body dynamics. The FMUs and the Python package compile the same
 * sources, so that both give the same bits.
 * What it demands: C99, IEEE 754 doubles, libm, -ffp-contract=off. Copy this folder to install it.
 * What it does not do: no allocation, no globals, no input or output, no clock. Every function is re-entrant; a structure may be
 * shared by threads that only read it. Structures hold no pointers: a copy of the bytes is a copy of the state.
 *
 * Units are SI. Base frame: origin in the plane of the shoulder axes, z up, arm 1 towards +x, arms at 0, 120 and 240 degrees.
 * Joint angles are measured from horizontal, positive downwards; elbows point outwards. Arrays of three are x, y, z or joints 1 to 3;
 * arrays of two are the pick side, then the place side.
 * "Paper" is Liang and Su, "Quintic Pythagorean-Hodograph Curves Based Trajectory Planning for Delta Robot with a Prescribed
 * Geometrical Constraint", Applied Sciences 9(21):4491, 2019; equation numbers are its own.
 *
 * This file is read by C compilers and by cffi: apart from the include guard it has no preprocessor lines. */
#ifndef DELTAPH_KERNEL_H
#define DELTAPH_KERNEL_H

/* ---- Verdicts ------------------------------------------------------------------------------------------------------------------ */

/* What became of a request. Numbered as PlanStatus in ../planner/variables.toml, which says what each means. */
typedef enum dph_status {
    DPH_STATUS_NONE,
    DPH_STATUS_OK,
    DPH_STATUS_INVALID_ROBOT,
    DPH_STATUS_INVALID_VALUE,
    DPH_STATUS_NOT_LEVEL,
    DPH_STATUS_LIFT_TOO_LOW,
    DPH_STATUS_TRAVERSE_TOO_SHORT,
    DPH_STATUS_TOO_SLOW,
    DPH_STATUS_UNREACHABLE,
    DPH_STATUS_JOINT_RANGE,
    DPH_STATUS_SINGULAR,
    DPH_STATUS_BUSY,
    DPH_STATUS_NOT_AT_PICK,
    DPH_STATUS_LIMIT_EXCEEDED,
    DPH_STATUS_NO_LIMIT,
    DPH_STATUS_PLANNING,
    DPH_STATUS_CANCELLED
} dph_status;

/* Phases of a PPO, numbered as Phase in ../planner/variables.toml. */
typedef enum dph_phase {
    DPH_PHASE_IDLE,
    DPH_PHASE_LIFT,
    DPH_PHASE_PICK_CORNER,
    DPH_PHASE_ACCELERATE,
    DPH_PHASE_DECELERATE,
    DPH_PHASE_PLACE_CORNER,
    DPH_PHASE_LOWER,
    DPH_PHASE_TRAVERSE,
    DPH_PHASE_DWELL
} dph_phase;

/* A refusal as facts: what was refused, where, how much it needs and how much there is. */
typedef struct dph_verdict {
    dph_status status;
    dph_phase phase;  /* where on the path; DPH_PHASE_IDLE where the whole task is meant */
    int joint;        /* 1 to 3, or 0 where no single joint is meant */
    double required;  /* [SI unit of the refused quantity] */
    double available; /* [the same unit] */
} dph_verdict;

/* Compose the one sentence that says a verdict, for a log, an exception or a screen.
 * Given:    verdict.
 * Returned: text, always terminated, cut at `size` characters.
 * Cost:     one snprintf. */
void dph_verdict_text(const dph_verdict *verdict, char *text, int size);

/* ---- Delta robot: kinematics (delta_kinematics.c) --------------------------------------------------------------------------------- */

/* The robot; three equal arms. Meaning, source and defaults of each value: ../robot.toml. */
typedef struct dph_robot {
    double base_radius, platform_radius, upper_arm_length, forearm_length; /* [m] */
    double upper_arm_mass;    /* [kg] */
    double upper_arm_com;     /* [m] from the shoulder axis */
    double upper_arm_inertia; /* [kg m^2] about the shoulder axis */
    double forearm_mass;      /* [kg] the rod pair */
    double forearm_inertia;   /* [kg m^2] the rod pair, transverse, about its centre */
    double platform_mass;     /* [kg] */
    double drive_inertia;     /* [kg m^2] reflected to the joint */
    double joint_position_min, joint_position_max; /* [rad] */
} dph_robot;

/* Is this a robot at all: finite, positive, closing?
 * Returned: OK or INVALID_ROBOT with the offending value as `available` and its bound as `required`. Cost: constant. */
dph_verdict dph_robot_check(const dph_robot *robot);

/* Inverse kinematics, elbow outwards.
 * Given:    point (3) [m].
 * Returned: theta (3) [rad].
 * Fails:    UNREACHABLE with the joint, and the distance shoulder to platform joint in the arm's plane against its bound; theta then
 *           keeps its value.
 * Cost:     three square roots, four divisions; no trigonometric function. */
dph_verdict dph_inverse_kinematics(const dph_robot *robot, const double point[3], double theta[3]);

/* Forward kinematics: the lower intersection of the three forearm spheres.
 * Given:    theta (3) [rad].
 * Returned: point (3) [m]; 1, or 0 where the spheres do not meet (point then keeps its value).
 * Cost:     six trigonometric functions, one square root. */
int dph_forward_kinematics(const dph_robot *robot, const double theta[3], double point[3]);

/* How far from the two kinds of singularity, both 0 there.
 * Given:    theta (3) [rad], point (3) [m] that belongs to it.
 * Returned: the smaller of min_i |s_i . E'_i| / (upper arm length * forearm length) (arm and forearm aligned: the joint moves nothing)
 *           and |det A| / forearm length^3, A having the forearm vectors s_i as rows (the joints cannot hold the platform).
 * Cost:     constant. */
double dph_dexterity(const dph_robot *robot, const double theta[3], const double point[3]);

/* How well a pose closes.
 * Given:    theta (3) [rad], point (3) [m].
 * Returned: the greatest | |s_i| - forearm length | [m].
 * Cost:     six trigonometric functions, three square roots. */
double dph_closure_residual(const dph_robot *robot, const double theta[3], const double point[3]);

/* Elbow positions, for drawing the robot in n poses.
 * Given: theta (n, 3) [rad]. Returned: elbow (n, 3 arms, 3) [m]. Cost: six trigonometric functions a pose. */
void dph_elbows(const dph_robot *robot, int n, const double *theta, double *elbow);

/* Motion of the joints that goes with a motion of the tool centre point, by differentiating |s_i|^2 = forearm length^2.
 * Given:    theta (3) that belongs to the point; velocity, acceleration, jerk (3) of the point [m/s, m/s^2, m/s^3].
 * Returned: joint velocity, acceleration, jerk (3) [rad/s, rad/s^2, rad/s^3].
 * Fails:    never for a dexterity above 0; at a singularity the result is not finite.
 * Cost:     six trigonometric functions, three divisions. */
void dph_joint_motion(const dph_robot *robot, const double theta[3], const double point[3], const double velocity[3],
                      const double acceleration[3], const double jerk[3], double joint_velocity[3],
                      double joint_acceleration[3], double joint_jerk[3]);

/* ---- Delta robot: dynamics (delta_dynamics.c) --------------------------------------------------------------------------------------- */

/* The whole mechanical state at one instant. */
typedef struct dph_motion {
    double theta[3], theta_d[3], theta_dd[3]; /* joints [rad, rad/s, rad/s^2] */
    double point[3], point_d[3], point_dd[3]; /* tool centre point [m, m/s, m/s^2] */
    double torque[3];                         /* on the joint side [N m] */
    double force[3];                          /* from outside on the platform, at the tool centre point [N] */
    double lambda[3];                         /* multipliers of |s_i|^2 / 2 = const [N/m]; rod pair force = lambda * forearm length [N] */
} dph_motion;

/* Inverse dynamics of the robot with rigid rods (paper eq. (1), completed by its platform rows).
 * Given:    motion.theta, theta_d, theta_dd, point, point_d, point_dd, consistent with one another, force; payload [kg].
 * Returned: motion.torque, motion.lambda.
 * Cost:     six trigonometric functions, one 3x3 solve. */
void dph_inverse_dynamics(const dph_robot *robot, double payload, dph_motion *motion);

/* Forward dynamics: the reduced three-coordinate equations with rigid rods.
 * Given:    motion.theta, theta_d, torque, force; payload [kg].
 * Returned: motion.theta_dd, point, point_d, point_dd, lambda; 1, or 0 where forward kinematics or the solution fails.
 * Cost:     six trigonometric functions, two 3x3 solves. */
int dph_forward_dynamics(const dph_robot *robot, double payload, dph_motion *motion);

/* The impact when the platform takes up a mass that is at rest: generalized momentum is kept, kinetic energy is lost.
 *   (Mr + m Jp^T Jp) theta'+ = Mr theta'-,  Mr = T^T M T the mass matrix in joint coordinates, m the mass taken up
 * Given:    motion.theta, theta_d, point that belongs to them; payload [kg] before and mass taken up [kg].
 * Returned: motion.theta_d; 1, or 0 where the solution fails (theta_d then keeps its value).
 * Cost:     six trigonometric functions, two 3x3 solves. */
int dph_take_up(const dph_robot *robot, double payload, double taken_up, dph_motion *motion);

/* ---- Corner (corner.c) ---------------------------------------------------------------------------------------------------------------- */

/* A quintic PH corner (paper section 3.1). Its preimage is u = u0 (1-g)^2 + u2 g^2, v = u2 g^2; the hodograph is x' = 2uv,
 * y' = u^2 - v^2. Origin where the corner begins, y along the first leg, x along the second; the vertex is at (0, leg). */
typedef struct dph_corner {
    double leg;        /* m, the vertical one in a PPO [m] */
    double second_leg; /* k, the horizontal one [m] */
    double deviation;  /* vertex to curve: the paper's d [m] */
    double u0, u2;     /* preimage coefficients [m^(1/2)] */
    double length;     /* arc length [m] */
} dph_corner;

/* A point of the corner with its derivatives by the curve parameter: [order][x, y] [m]. */
typedef struct dph_corner_point {
    double p[4][2];
    double sigma[3]; /* parametric speed and its first two derivatives [m] */
    double length;   /* arc length from the start [m] */
} dph_corner_point;

/* The corner with equal legs whose vertex is `deviation` > 0 away from the curve (eq. (13)). Cost: three square roots. */
void dph_corner_from_deviation(double deviation, dph_corner *corner);

/* The corner with two legs m, k > 0; its deviation is found. Cost: some five points of the corner. */
void dph_corner_from_legs(double leg, double second_leg, dph_corner *corner);

/* The leg that together with a leg gives a corner its deviation; `most` where it would be longer [m].
 * Given:    leg, shorter than the equal legs of that deviation; which of the two does not matter, the mirror image swaps them.
 * Cost:     some ten corners from their legs, 61 at most. */
double dph_corner_longer_leg(double leg, double deviation, double most);

/* The corner at curve parameter gamma in [0, 1] (eqs. (3), (4), (18)). Cost: polynomials. */
void dph_corner_at(const dph_corner *corner, double gamma, dph_corner_point *point);

/* ---- Motion law on a corner (corner_law.c) ---------------------------------------------------------------------------------------------- */

/* Greatest number of panels of one corner. */
enum { DPH_PANELS = 48 };

/* Path speed v(gamma) = V_B - 16 (V_B - V_N) gamma^2 (1-gamma)^2 on a corner (eq. (16)), and t(gamma) = int sigma / v (eq. (20)) by
 * Gauss-Legendre quadrature on graded panels: valid for every V_N > 0. */
typedef struct dph_corner_law {
    dph_corner corner;
    double entry_speed, mid_speed; /* V_B, V_N [m/s] */
    double duration;               /* T_2 [s] */
    int panels;                    /* 16 for V_N of about V_B, 30 to 48 far from it */
    int pieces;                    /* of six quadrature points to a panel: 1, 2, 4 or 8 */
    double gamma[DPH_PANELS + 1];  /* panel ends */
    double time[DPH_PANELS + 1];   /* t(gamma) there [s] */
    double series[DPH_PANELS + 1][3]; /* Taylor's, of gamma(t) there [1/s, 1/s^2, 1/s^3] */
} dph_corner_law;

/* Prepare the law. Given: corner, speeds > 0 [m/s]. Cost: six evaluations of sigma / v per piece; of 16 panels 0.6 us on a 3.5 GHz core. */
void dph_corner_law_make(const dph_corner *corner, double entry_speed, double mid_speed, dph_corner_law *law);

/* The curve parameters at n times in [0, duration] [s] (eq. (27)).
 * Returned: gamma (n); steps (n), how many of Newton's method each took, or NULL where nobody asks.
 * Cost:     a step costs six evaluations of sigma / v per piece and a series: 0.06 us for one. V_N from V_B / 30 to 16 V_B takes one but
 *           for a few times around 2 V_B, V_N further from V_B two, and five at 1e15 V_B. */
void dph_corner_law_gamma(const dph_corner_law *law, int n, const double *time, double *gamma, int *steps);

/* ---- Plan (plan.c; paper.c, superposition.c, paper_limited.c and time_optimal.c hold the laws) ------------------------------------------- */

/* Numbered as Law in ../planner/variables.toml. */
typedef enum dph_law { DPH_LAW_PAPER, DPH_LAW_COMPARISON, DPH_LAW_PAPER_LIMITED, DPH_LAW_TIME_OPTIMAL } dph_law;

/* What the motion may reach, over continuous time; a value of 1e30 or more means no limit. The laws paper and comparison ignore them. */
typedef struct dph_limits {
    double joint_velocity[3];     /* [rad/s] */
    double joint_acceleration[3]; /* [rad/s^2] */
    double joint_jerk[3];         /* [rad/s^3] */
    double joint_torque[3];       /* on the joint side [N m] */
    double tcp_speed;             /* [m/s] */
} dph_limits;

/* What is asked for. Arrays of two: pick side, place side. */
typedef struct dph_task {
    double pick[3], place[3];    /* [m] */
    double lift[2];              /* [m] */
    double corner_deviation[2];  /* prescribed [m] */
    double dwell;                /* rest at the pick point before the motion [s] */
    double payload;              /* [kg] */
    dph_law law;
    double corner_entry_speed;   /* V_B; comparison: greatest vertical speed [m/s] */
    double corner_mid_speed;     /* V_N; unused by comparison [m/s] */
    double traverse_speed;       /* V_max; comparison: greatest horizontal speed [m/s] */
    double overlap;              /* comparison: share of a vertical stroke's time; unused by the paper's law */
    dph_limits limits;           /* paper_limited and time_optimal */
} dph_task;

/* One half of a PPO, from rest to the middle of the traverse: phases 1 to 3. The place side is run backwards in time. A side without lift
 * has no corner: its lift, corner and entry speed are 0. */
typedef struct dph_side {
    double lift_length;     /* j [m] */
    double lift_duration;   /* T_1 [s] */
    double cruise_length;   /* half the straight part of the traverse [m] */
    double cruise_duration; /* T_3 [s] */
    double traverse_speed;  /* V_max [m/s] */
    dph_corner_law corner;
} dph_side;

/* Greatest number of pieces on which a plan is infinitely differentiable. */
enum { DPH_PIECES = 64 };

/* A plan: immutable once made. Times without a word are on the aligned clock: nominal time = speed_factor * time. */
typedef struct dph_plan {
    dph_robot robot;
    dph_task task;
    double direction[2];         /* horizontal unit vector from pick to place */
    double traverse;             /* w: horizontal distance from pick to place [m] */
    double nominal_duration;     /* [s] */
    int duration_ms;             /* aligned duration [ms] */
    double duration;             /* the same [s] */
    double speed_factor;         /* nominal / aligned duration, at most 1 */
    int dwell_ms;                /* dwell, rounded up to the same grid; it is no part of the duration: the motion begins at time 0 [ms] */
    double length;               /* arc length of the path [m] */
    double segment_arc[7];       /* arc length at the ends of lift, corners, halves of the traverse, lowering; not of comparison [m] */
    double corner_deviation[2];  /* vertex to path, by construction or found [m]; 0 where there is no lift and so no corner */
    int corner_bound[2];         /* what held the corner's legs: 1 its lift, 2 the traverse, 3 both, 0 neither */
    double middle[2];            /* direction of the stretch between the corners: horizontal, vertical; (1, 0) unless nothing is level */
    int pieces;
    dph_phase phase[DPH_PIECES];         /* of each piece */
    double boundary[DPH_PIECES + 1];     /* nominal times at which the pieces begin and end [s] */
    double arc_boundary[DPH_PIECES + 1]; /* arc length there [m] */
    dph_side side[2];            /* without comparison; the motion in it of the paper's laws only */
    /* Time-optimal law: b = (dx/dt)^2, a cubic on every piece, x the path parameter (path.h). */
    double parameter[DPH_PIECES + 1]; /* x at the ends of the pieces */
    double b[DPH_PIECES + 1];         /* b there [1/s^2] */
    double b_slope[DPH_PIECES + 1];   /* db/dx there [1/s^2] */
} dph_plan;

/* Memory of a planner: where planning in slices stands, and the time-optimal law's solver. It means something from dph_plan_begin until
 * the verdict, and nothing before and after. */
typedef struct dph_workspace dph_workspace;

/* Size of a workspace [bytes], below 2^19; any memory that is aligned for double will do. */
int dph_workspace_size(void);

/* A setpoint: everything the planner says about one instant. */
typedef struct dph_setpoint {
    double joint_position[3], joint_velocity[3], joint_acceleration[3], joint_torque[3];
    double tcp_position[3], tcp_velocity[3], tcp_acceleration[3];
    double arc_length;      /* [m] */
    double length;          /* of the whole path [m] */
    double vertex_distance; /* to the vertex of the nearer corner [m] */
    double joint_jerk[3], tcp_jerk[3];
    dph_phase phase;
} dph_setpoint;

/* Suprema over continuous time of the absolute values, one-sided where a derivative jumps. */
typedef struct dph_peaks {
    double joint_velocity[3], joint_acceleration[3], joint_jerk[3], joint_torque[3];
    double tcp_speed, tcp_acceleration;
} dph_peaks;

/* Plan a PPO.
 * Given:    workspace for the time-optimal law; NULL will do for the others.
 * Returned: plan, and status OK; the plan is only meaningful then.
 * Fails:    with a verdict, for every finite or not finite input; never crashes, never loops without end.
 * Cost:     the quadratures of two corners; a pose wherever the last one vouches for no more of the path, some ten in the middle of the
 *           workspace: 15 units (see below), 1.6 us on a 3.5 GHz core (comparison: 15 us). paper_limited: the peaks of some hundred plans
 *           besides, 8 000 to 16 000 units. time_optimal: some seven hundred poses, verifications and at most 55 steps of its solver
 *           instead, 2 500 to 7 500 units; where only velocity and acceleration are limited, some 120 poses and at most eight passes over
 *           the path, 170 units. */
dph_verdict dph_plan_make(const dph_robot *robot, const dph_task *task, dph_workspace *workspace, dph_plan *plan);

/* Work is counted in units, not timed, so that slices of it are the same everywhere. A unit is the work of about one point of the path: a
 * pose with its derivatives and what the limits say there, 0.2 to 0.45 us on the machine whose figures the README has. A slice of DPH_SLICE
 * units is what a planner may do in one millisecond beside all else: 0.24 ms there at most (found on 400 random tasks of all laws). A PPO
 * of `paper` or `comparison` takes one slice. */
enum { DPH_SLICE = 512 };

/* Begin to plan a PPO in slices; dph_plan_make is the same thing in one go, and gives the same bits.
 * Given:    workspace, for every law.
 * Returned: workspace, and plan, which both belong to the planning from now on: they may be copied, as bytes, and go on elsewhere.
 *           Status PLANNING: dph_plan_continue is to follow.
 * Fails:    with a verdict, where a look at the numbers is enough.
 * Cost:     constant. */
dph_verdict dph_plan_begin(const dph_robot *robot, const dph_task *task, dph_workspace *workspace, dph_plan *plan);

/* Go on planning for some `units` of work.
 * Returned: status PLANNING while there is more to do; else the verdict of dph_plan_make, and no more calls are due.
 * Cost:     the units, and at most 140 more: work is left at seams only. */
dph_verdict dph_plan_continue(dph_workspace *workspace, dph_plan *plan, int units);

/* The setpoint at a time [s] on the aligned clock, clamped to [0, duration]: before the start the robot rests at the pick point (its phase
 * is dwell from -dwell_ms on), from the end on at the place point, exactly.
 * Cost: one corner law inversion, one inverse kinematics and dynamics: 0.16 us on a 3.5 GHz core with the paper's law. The other
 * laws take quadratures of their own: time_optimal 0.5 us, comparison 1.3 us. */
void dph_plan_sample(const dph_plan *plan, double time, dph_setpoint *setpoint);

/* The same for n times. */
void dph_plan_sample_array(const dph_plan *plan, int n, const double *time, dph_setpoint *setpoint);

/* Joints alone at n times, with the bits of dph_plan_sample.
 * Returned: position, velocity, acceleration (n, 3) [rad, rad/s, rad/s^2].
 * Cost:     three quarters of dph_plan_sample_array with the paper's law. */
void dph_plan_sample_joints(const dph_plan *plan, int n, const double *time, double *position, double *velocity, double *acceleration);

/* The setpoint under a path-speed override: the plan's own clock runs at a rate r(t), and `time` is where it stands.
 * Given:    rate: r, dr/dt, d2r/dt2 [1, 1/s, 1/s^2]. With r = 1 at rest the result is that of dph_plan_sample, to the bit.
 * Returned: velocity P' r, acceleration P'' r^2 + P' dr/dt, and so on, and the joints and torques that go with them.
 * Cost:     one more inverse kinematics and dynamics. */
void dph_plan_sample_at_rate(const dph_plan *plan, double time, const double rate[3], dph_setpoint *setpoint);

/* The setpoint of a robot at rest.
 * Given: point (3) [m], payload [kg]. Fails: as dph_inverse_kinematics; setpoint then keeps its value. */
dph_verdict dph_rest(const dph_robot *robot, const double point[3], double payload, dph_setpoint *setpoint);

/* Peaks of a plan: a scan of every piece, refined. Limits: planner/README.md. Cost: some thousand setpoints. */
void dph_plan_peaks(const dph_plan *plan, dph_peaks *peaks);

#endif
