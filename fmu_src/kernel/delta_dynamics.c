/* Rigid-body dynamics of the Delta robot with rigid rods: paper eq. (1) completed by its platform rows.
 *
 * Coordinates q = (theta, p), closures phi_i = (|s_i|^2 - l^2) / 2 = 0 (delta_arms.h), Jacobian J = [-diag(b), A]: b_i is
 * s_i . E'_i and A has the rows s_i. A rod without spin turns at s x s' / l^2, so that a pair of mass mf with
 * transverse inertia If has
 *   T = mf |(E + p)' / 2|^2 / 2 + (If / l^2) |p' - E'|^2 / 2,
 * which makes M constant but for the coupling of arm and platform. No part of it is lumped to elbow and platform.
 *   M q'' + h + J^T lambda = (tau, force) */
#include <math.h>
#include <string.h>

#include "delta_arms.h"

/* Standard gravity [m/s^2]. */
static const double gravity = 9.80665;

/* The constants of M and h. */
typedef struct {
    double arm;             /* M_ii: upper arm, drive and the rods' share [kg m^2] */
    double coupling;        /* M_ip = coupling E'_i [kg] */
    double platform;        /* M_pp: platform, payload and the rods' share [kg] */
    double arm_weight;      /* h_i = -arm_weight cos theta_i [N m] */
    double platform_weight; /* vertical part of h_p [N] */
} Inertia;

static Inertia inertia_of(const dph_robot *robot, double payload)
{
    double upper = robot->upper_arm_length, l = robot->forearm_length, mf = robot->forearm_mass;
    double turning = robot->forearm_inertia / (l * l), same_end = 0.25 * mf + turning;
    Inertia inertia = {
        .arm = robot->upper_arm_inertia + robot->drive_inertia + same_end * upper * upper,
        .coupling = 0.25 * mf - turning,
        .platform = robot->platform_mass + payload + 3.0 * same_end,
        .arm_weight = gravity * (robot->upper_arm_mass * robot->upper_arm_com + 0.5 * mf * upper),
        .platform_weight = gravity * (robot->platform_mass + payload + 1.5 * mf),
    };
    return inertia;
}

/* Platform rows of h, less the force from outside. */
static void platform_load(const Inertia *m, const dph_motion *motion, double force[3])
{
    force[0] = 0.0 - motion->force[0];
    force[1] = 0.0 - motion->force[1];
    force[2] = m->platform_weight - motion->force[2];
}

/* lambda from the platform rows A^T lambda = -f_p. */
static void multipliers(const dph_inverse *inverse, const double platform_force[3], double lambda[3])
{
    for (int i = 0; i < 3; ++i)
        lambda[i] = -dot(inverse->column[i], platform_force);
}

void dph_pose_dynamics(const dph_robot *robot, const dph_pose *pose, double payload, dph_motion *motion)
{
    Inertia m = inertia_of(robot, payload);
    double coupling = m.coupling * pose->upper, normal[3][3], carried[3];
    double p0 = motion->point_dd[0], p1 = motion->point_dd[1], p2 = motion->point_dd[2];
    double f0 = m.platform * p0 - motion->force[0], f1 = m.platform * p1 - motion->force[1];
    double f2 = m.platform * p2 + m.platform_weight - motion->force[2];
    for (int i = 0; i < 3; ++i) {
        /* coupling (E' theta'' + E'' theta'^2) and -coupling E' . p'', E' = -La (u sin + k cos), E'' = -La (u cos - k sin) */
        const dph_limb *limb = &pose->limb[i];
        const double *u = arm_direction[i];
        double a = motion->theta_dd[i], w2 = motion->theta_d[i] * motion->theta_d[i];
        double out = coupling * (limb->sine * a + limb->cosine * w2);
        f0 -= out * u[0];
        f1 -= out * u[1];
        f2 -= coupling * (limb->cosine * a - limb->sine * w2);
        carried[i] = coupling * (limb->sine * (p0 * u[0] + p1 * u[1]) + limb->cosine * p2);
    }

    /* lambda from the platform rows A^T lambda = -f, by Cramer's rule. */
    const double *s0 = pose->limb[0].s, *s1 = pose->limb[1].s, *s2 = pose->limb[2].s;
    cross(s1, s2, normal[0]);
    cross(s2, s0, normal[1]);
    cross(s0, s1, normal[2]);
    double scale = -1.0 / dot(s0, normal[0]);
    for (int i = 0; i < 3; ++i) {
        const dph_limb *limb = &pose->limb[i];
        motion->lambda[i] = scale * (normal[i][0] * f0 + normal[i][1] * f1 + normal[i][2] * f2);
        motion->torque[i] = m.arm * motion->theta_dd[i] - carried[i] - m.arm_weight * limb->cosine -
                            pose->upper * limb->across * motion->lambda[i];
    }
}

void dph_inverse_dynamics(const dph_robot *robot, double payload, dph_motion *motion)
{
    dph_pose pose;
    dph_pose_from(robot, motion->theta, motion->point, &pose);
    dph_pose_dynamics(robot, &pose, payload, motion);
}

/* Solve the symmetric positive definite a x = f by a = L D L^T; x replaces f. Returns 0 where a is not positive definite. */
static int solve_definite(double a[3][3], double f[3])
{
    double d0 = a[0][0];
    if (!(d0 > 0.0))
        return 0;
    double r0 = 1.0 / d0, l10 = a[1][0] * r0, l20 = a[2][0] * r0;
    double d1 = a[1][1] - l10 * a[1][0];
    if (!(d1 > 0.0))
        return 0;
    double r1 = 1.0 / d1, c21 = a[2][1] - l20 * a[1][0], l21 = c21 * r1;
    double d2 = a[2][2] - l20 * a[2][0] - l21 * c21;
    if (!(d2 > 0.0))
        return 0;
    f[1] -= l10 * f[0];
    f[2] -= l20 * f[0] + l21 * f[1];
    f[2] /= d2;
    f[1] = f[1] * r1 - l21 * f[2];
    f[0] = f[0] * r0 - l10 * f[1] - l20 * f[2];
    return 1;
}

/* The arms of a pose with its Jacobian. */
typedef struct {
    dph_arm arm[3];
    double s[3][3];
    dph_inverse inverse; /* of A */
    double jp[3][3];     /* columns of Jp = A^-1 diag(b) */
} Pose;

static void pose_at(const dph_robot *robot, const double point[3], Pose *pose)
{
    for (int i = 0; i < 3; ++i)
        forearm_at(robot, i, &pose->arm[i], point, pose->s[i]);
    invert_rows(pose->s, &pose->inverse);
    for (int i = 0; i < 3; ++i) {
        double b = dot(pose->s[i], pose->arm[i].elbow_d);
        for (int k = 0; k < 3; ++k)
            pose->jp[i][k] = b * pose->inverse.column[i][k];
    }
}

/* p' = Jp theta'. */
static void platform_velocity(const Pose *pose, const double w[3], double velocity[3])
{
    velocity[0] = velocity[1] = velocity[2] = 0.0;
    for (int i = 0; i < 3; ++i)
        add_scaled(velocity, w[i], pose->jp[i]);
}

/* The lower triangle of T^T M T. */
static void reduced_mass(const Inertia *m, const Pose *pose, double mass[3][3])
{
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k <= i; ++k)
            mass[i][k] = m->coupling * (dot(pose->arm[i].elbow_d, pose->jp[k]) + dot(pose->arm[k].elbow_d, pose->jp[i])) +
                         m->platform * dot(pose->jp[i], pose->jp[k]);
        mass[i][i] += m->arm;
    }
}

/* With p' = Jp theta' and p'' = Jp theta'' + c, Jp = A^-1 diag(b), the equations of motion become
 *   (T^T M T) theta'' = tau - T^T (h - force + M (0, c)),  T = [1; Jp]. */
int dph_forward_dynamics(const dph_robot *robot, double payload, dph_motion *motion)
{
    Inertia m = inertia_of(robot, payload);
    const double *w = motion->theta_d;
    Pose pose;
    for (int i = 0; i < 3; ++i)
        arm_at(robot, i, motion->theta[i], &pose.arm[i]);
    if (!platform_below(robot, pose.arm, motion->point))
        return 0;
    pose_at(robot, motion->point, &pose);
    const dph_arm *arm = pose.arm;

    double velocity[3];
    platform_velocity(&pose, w, velocity);

    /* c = -A^-1 gamma, gamma_i = |s'_i|^2 - (s_i . E''_i) w_i^2; force: h_p, then h_p + M_pp c. */
    double bias[3] = {0.0, 0.0, 0.0}, force[3];
    platform_load(&m, motion, force);
    for (int i = 0; i < 3; ++i) {
        double s_d[3];
        for (int k = 0; k < 3; ++k)
            s_d[k] = velocity[k] - w[i] * arm[i].elbow_d[k];
        double gamma = dot(s_d, s_d) - dot(pose.s[i], arm[i].elbow_dd) * w[i] * w[i];
        add_scaled(bias, -gamma, pose.inverse.column[i]);
        add_scaled(force, m.coupling * w[i] * w[i], arm[i].elbow_dd);
    }
    add_scaled(force, m.platform, bias);

    double mass[3][3], acceleration[3], arm_weight = m.arm_weight / robot->upper_arm_length;
    reduced_mass(&m, &pose, mass);
    for (int i = 0; i < 3; ++i)
        acceleration[i] = motion->torque[i] - arm_weight * arm[i].elbow_d[2] - m.coupling * dot(arm[i].elbow_d, bias) -
                          dot(pose.jp[i], force);
    if (!solve_definite(mass, acceleration))
        return 0;

    double platform[3] = {bias[0], bias[1], bias[2]};
    for (int i = 0; i < 3; ++i) {
        add_scaled(platform, acceleration[i], pose.jp[i]);
        add_scaled(force, m.coupling * acceleration[i], arm[i].elbow_d);
        add_scaled(force, m.platform * acceleration[i], pose.jp[i]);
    }
    multipliers(&pose.inverse, force, motion->lambda);

    double finite = 0.0;
    for (int i = 0; i < 3; ++i) {
        motion->theta_dd[i] = acceleration[i];
        motion->point_d[i] = velocity[i];
        motion->point_dd[i] = platform[i];
        finite += fabs(acceleration[i]) + fabs(velocity[i]) + fabs(platform[i]) + fabs(motion->lambda[i]);
    }
    return isfinite(finite);
}

/* Mr theta'- = (Mr + m Jp^T Jp) theta'+, written for the change: (Mr + m Jp^T Jp) (theta'- - theta'+) = m Jp^T p'-. */
int dph_take_up(const dph_robot *robot, double payload, double taken_up, dph_motion *motion)
{
    Inertia after = inertia_of(robot, payload + taken_up);
    Pose pose;
    double velocity[3], mass[3][3], change[3];
    for (int i = 0; i < 3; ++i)
        arm_at(robot, i, motion->theta[i], &pose.arm[i]);
    pose_at(robot, motion->point, &pose);
    platform_velocity(&pose, motion->theta_d, velocity);
    reduced_mass(&after, &pose, mass);
    for (int i = 0; i < 3; ++i)
        change[i] = taken_up * dot(pose.jp[i], velocity);
    if (!solve_definite(mass, change) || !isfinite(fabs(change[0]) + fabs(change[1]) + fabs(change[2])))
        return 0;
    for (int i = 0; i < 3; ++i)
        motion->theta_d[i] -= change[i];
    return 1;
}
