/* The three arms in one pose: what kinematics and dynamics share. E_i is the elbow (of a pair of rods: between the two), s_i the
 * forearm from there to the platform, u_i the horizontal unit vector along arm i, k the vertical; cos and sin are those of theta_i.
 * Loop closure: phi_i = (|s_i|^2 - forearm_length^2) / 2 = 0. */
#ifndef DELTAPH_DELTA_ARMS_H
#define DELTAPH_DELTA_ARMS_H

#include <math.h>

#include "kernel.h"
#include "vector.h"

/* u_i at 0, 120 and 240 degrees. */
static const double arm_direction[3][2] = {{1.0, 0.0}, {-0.5, 0.86602540378443864676}, {-0.5, -0.86602540378443864676}};

/* One arm: elbow E, its derivatives by theta, forearm vector. */
typedef struct dph_arm {
    double elbow[3], elbow_d[3], elbow_dd[3]; /* E, E' = -La (u sin + k cos), E'' = -La (u cos - k sin) [m] */
} dph_arm;

/* Arm i in its own vertical plane, whose axes are u_i (outwards) and k (up). The platform joint lies at (x, z) from the shoulder; `along` the
 * upper arm and `across` it, below, are x cos - z sin and -(x sin + z cos). With them s . E' = La across, s . E'' = La (La - along). */
typedef struct dph_limb {
    double cosine, sine;  /* of theta */
    double along, across; /* [m] */
    double s[3];          /* forearm vector in the base frame [m] */
} dph_limb;

/* The three arms at one point, without the angles themselves. */
typedef struct dph_pose {
    double upper; /* La [m] */
    dph_limb limb[3];
} dph_pose;

/* The pose at a point (3) [m]. Fails: as dph_inverse_kinematics. Cost: three square roots, four divisions. */
dph_verdict dph_pose_at(const dph_robot *robot, const double point[3], dph_pose *pose);

/* The pose of joint angles (3) [rad] and the point that belongs to them. Cost: six trigonometric functions. */
void dph_pose_from(const dph_robot *robot, const double theta[3], const double point[3], dph_pose *pose);

/* The joint angles of a pose (3) [rad]. Cost: polynomials. */
void dph_pose_angles(const dph_pose *pose, double theta[3]);

/* The two kinds of dexterity apart: |s_i . E'_i| / (La l) of each joint, |det A| / l^3. */
void dph_pose_dexterities(const dph_robot *robot, const dph_pose *pose, double aligned[3], double *coplanar);

/* As dph_joint_motion and dph_inverse_dynamics, from a pose: no trigonometric function. */
void dph_pose_motion(const dph_pose *pose, const double velocity[3], const double acceleration[3], const double jerk[3],
                     double joint_velocity[3], double joint_acceleration[3], double joint_jerk[3]);
/* The first two of it. */
void dph_pose_acceleration(const dph_pose *pose, const double velocity[3], const double acceleration[3], double joint_velocity[3],
                           double joint_acceleration[3]);
void dph_pose_dynamics(const dph_robot *robot, const dph_pose *pose, double payload, dph_motion *motion);

/* What planning asks of a point: first two derivatives of the joints that go with those of the point by any parameter (q'[3], q''[3]),
 * direction as in a pose, and how far from the singularities, as dph_dexterity.
 * Returned: 1, or 0 where the point cannot be reached. Cost: three square roots, six divisions. */
typedef struct dph_rates {
    double q[2][3], direction[3][2], dexterity;
} dph_rates;

int dph_rates_at(const dph_robot *robot, const double point[3], const double first[3], const double second[3], dph_rates *rates);

static inline void arm_at(const dph_robot *robot, int i, double theta, dph_arm *arm)
{
    const double *u = arm_direction[i];
    double across = robot->upper_arm_length * cos(theta), down = robot->upper_arm_length * sin(theta);
    double out = robot->base_radius + across;
    for (int k = 0; k < 2; ++k) {
        arm->elbow[k] = out * u[k];
        arm->elbow_d[k] = -down * u[k];
        arm->elbow_dd[k] = -across * u[k];
    }
    arm->elbow[2] = -down;
    arm->elbow_d[2] = -across;
    arm->elbow_dd[2] = down;
}

/* Forearm vector s = p + r u - E. */
static inline void forearm_at(const dph_robot *robot, int i, const dph_arm *arm, const double point[3], double s[3])
{
    s[0] = point[0] + robot->platform_radius * arm_direction[i][0] - arm->elbow[0];
    s[1] = point[1] + robot->platform_radius * arm_direction[i][1] - arm->elbow[1];
    s[2] = point[2] - arm->elbow[2];
}

/* The lower point at forearm length from the three sphere centres E_i - r u_i: below their circumcentre, on its normal. Returns 0
 * where there is none; every comparison is false for a NaN. */
static inline int platform_below(const dph_robot *robot, const dph_arm arm[3], double point[3])
{
    double centre[3][3], a[3], b[3], n[3], na[3], bn[3];
    for (int i = 0; i < 3; ++i) {
        centre[i][0] = arm[i].elbow[0] - robot->platform_radius * arm_direction[i][0];
        centre[i][1] = arm[i].elbow[1] - robot->platform_radius * arm_direction[i][1];
        centre[i][2] = arm[i].elbow[2];
    }
    subtract(centre[1], centre[0], a);
    subtract(centre[2], centre[0], b);
    cross(a, b, n);
    cross(n, a, na);
    cross(b, n, bn);

    /* Circumcentre from the first centre: (|b|^2 n x a + |a|^2 b x n) / (2 |n|^2). */
    double n2 = dot(n, n), half = 0.5 / n2;
    double aa = half * dot(a, a), bb = half * dot(b, b), q[3];
    for (int k = 0; k < 3; ++k)
        q[k] = bb * na[k] + aa * bn[k];
    double height2 = robot->forearm_length * robot->forearm_length - dot(q, q);
    if (!(height2 >= 0.0))
        return 0;
    double drop = copysign(sqrt(height2 / n2), n[2]);
    if (!isfinite(drop))
        return 0;
    for (int k = 0; k < 3; ++k)
        point[k] = centre[0][k] + q[k] - drop * n[k];
    return 1;
}

#endif
