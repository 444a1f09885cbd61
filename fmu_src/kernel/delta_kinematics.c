/* Kinematics of the Delta robot: everything follows from |s_i|^2 = forearm_length^2 (delta_arms.h), in closed form. */
#include <math.h>
#include <stddef.h>

#include "delta_arms.h"

#include "laws.h"

/* Bounds of a robot's lengths, masses and inertias: far beyond any robot, and their products neither overflow nor underflow. */
static const double smallest = 1e-9, greatest = 1e6;

static const double half_turn = 3.14159265358979323846;

static dph_verdict invalid(double value, double bound)
{
    return dph_refuse(DPH_STATUS_INVALID_ROBOT, DPH_PHASE_IDLE, 0, bound, value);
}

/* Accept a value in [least, most]; nothing else, no NaN either. */
static dph_verdict between(double value, double least, double most)
{
    if (!(value >= least))
        return invalid(value, least);
    if (!(value <= most))
        return invalid(value, most);
    return dph_accept();
}

dph_verdict dph_robot_check(const dph_robot *robot)
{
    double bias = fabs(robot->base_radius - robot->platform_radius);
    const double checks[][3] = {
        /* value, least, most */
        {robot->base_radius, 0.0, greatest},
        {robot->platform_radius, 0.0, greatest},
        {robot->upper_arm_length, smallest, greatest},
        {robot->forearm_length, smallest, greatest},
        {robot->upper_arm_mass, 0.0, greatest},
        {robot->upper_arm_com, -greatest, greatest},
        {robot->upper_arm_inertia, 0.0, greatest},
        {robot->forearm_mass, 0.0, greatest},
        {robot->forearm_inertia, 0.0, greatest},
        {robot->platform_mass, 0.0, greatest},
        {robot->drive_inertia, 0.0, greatest},
        /* Positive definite mass matrix, even of a massless platform on massless rods. */
        {robot->upper_arm_inertia + robot->drive_inertia, smallest, greatest},
        {robot->joint_position_min, -half_turn, half_turn},
        {robot->joint_position_max, robot->joint_position_min, half_turn},
        /* Arms stretched out evenly reach the axis in some pose: the robot closes. */
        {robot->upper_arm_length + robot->forearm_length, bias, 2.0 * greatest},
    };
    for (size_t i = 0; i < sizeof checks / sizeof *checks; ++i) {
        dph_verdict verdict = between(checks[i][0], checks[i][1], checks[i][2]);
        if (verdict.status != DPH_STATUS_OK)
            return verdict;
    }
    return dph_accept();
}

static dph_verdict unreachable(int i, double required, double available)
{
    return dph_refuse(DPH_STATUS_UNREACHABLE, DPH_PHASE_IDLE, i + 1, required, available);
}

/* One joint. In the plane of arm i the platform joint lies x outwards of the shoulder and z above it, y beside the plane. The
 * closure x cos - z sin = K := (x^2 + z^2 + La^2 + y^2 - l^2) / (2 La) has two solutions; with the minus branch, the smaller angle,
 * the elbow is outwards. Returned: cosine and sine of the angle, both times x^2 + z^2, which is `plane2`. */
static dph_verdict upper_arm(const dph_robot *robot, int i, const double point[3], double direction[2], double *plane2)
{
    const double *u = arm_direction[i];
    double upper = robot->upper_arm_length, forearm = robot->forearm_length;
    double x = point[0] * u[0] + point[1] * u[1] + robot->platform_radius - robot->base_radius;
    double y = point[1] * u[0] - point[0] * u[1], z = point[2];

    double p2 = x * x + z * z, plane = sqrt(p2);
    if (!(fabs(y) <= forearm)) /* the forearm cannot even lean that far */
        return unreachable(i, fabs(y), forearm);
    double lean2 = (forearm - y) * (forearm + y), lean = sqrt(lean2);
    if (!(plane <= upper + lean))
        return unreachable(i, plane, upper + lean);
    if (!(plane >= fabs(upper - lean)))
        return unreachable(i, plane, fabs(upper - lean));

    double k = (p2 + upper * upper - lean2) / (2.0 * upper);
    double root2 = p2 - k * k; /* at the bounds 0 but for rounding */
    double root = root2 > 0.0 ? sqrt(root2) : 0.0;
    direction[0] = x * k - z * root;
    direction[1] = -z * k - x * root;
    *plane2 = p2;
    return dph_accept();
}

dph_verdict dph_inverse_kinematics(const dph_robot *robot, const double point[3], double theta[3])
{
    double angle[3], direction[2], plane2;
    for (int i = 0; i < 3; ++i) {
        dph_verdict verdict = upper_arm(robot, i, point, direction, &plane2);
        if (verdict.status != DPH_STATUS_OK)
            return verdict;
        angle[i] = atan2(direction[1], direction[0]);
    }
    for (int i = 0; i < 3; ++i)
        theta[i] = angle[i];
    return dph_accept();
}

dph_verdict dph_pose_at(const dph_robot *robot, const double point[3], dph_pose *pose)
{
    for (int i = 0; i < 3; ++i) {
        double plane2;
        dph_verdict verdict = upper_arm(robot, i, point, pose->direction[i], &plane2);
        if (verdict.status != DPH_STATUS_OK)
            return verdict;
        /* A platform joint on its shoulder leaves the angle open: as atan2 has it, 0. */
        double scale = plane2 > 0.0 ? 1.0 / plane2 : 0.0;
        arm_along(robot, i, plane2 > 0.0 ? scale * pose->direction[i][0] : 1.0, scale * pose->direction[i][1], &pose->arm[i]);
        forearm_at(robot, i, &pose->arm[i], point, pose->s[i]);
    }
    return dph_accept();
}

int dph_forward_kinematics(const dph_robot *robot, const double theta[3], double point[3])
{
    dph_arm arm[3];
    for (int i = 0; i < 3; ++i)
        arm_at(robot, i, theta[i], &arm[i]);
    return platform_below(robot, arm, point);
}

double dph_pose_dexterity(const dph_robot *robot, const dph_pose *pose)
{
    double normal[3], least = HUGE_VAL, forearm = robot->forearm_length;
    double scale = robot->upper_arm_length * forearm;
    for (int i = 0; i < 3; ++i)
        least = fmin(least, fabs(dot(pose->s[i], pose->arm[i].elbow_d)) / scale);
    cross(pose->s[1], pose->s[2], normal);
    return fmin(least, fabs(dot(pose->s[0], normal)) / (forearm * forearm * forearm));
}

/* The pose from joint angles and the point that belongs to them; without `direction`. */
static void pose_from(const dph_robot *robot, const double theta[3], const double point[3], dph_pose *pose)
{
    for (int i = 0; i < 3; ++i) {
        arm_at(robot, i, theta[i], &pose->arm[i]);
        forearm_at(robot, i, &pose->arm[i], point, pose->s[i]);
    }
}

double dph_dexterity(const dph_robot *robot, const double theta[3], const double point[3])
{
    dph_pose pose;
    pose_from(robot, theta, point, &pose);
    return dph_pose_dexterity(robot, &pose);
}

double dph_closure_residual(const dph_robot *robot, const double theta[3], const double point[3])
{
    double residual = 0.0;
    for (int i = 0; i < 3; ++i) {
        dph_arm arm;
        double s[3];
        arm_at(robot, i, theta[i], &arm);
        forearm_at(robot, i, &arm, point, s);
        residual = fmax(residual, fabs(sqrt(dot(s, s)) - robot->forearm_length));
    }
    return residual;
}

void dph_elbows(const dph_robot *robot, int n, const double *theta, double *elbow)
{
    for (int j = 0; j < 3 * n; ++j) {
        dph_arm arm;
        arm_at(robot, j % 3, theta[j], &arm);
        for (int k = 0; k < 3; ++k)
            elbow[3 * j + k] = arm.elbow[k];
    }
}

void dph_pose_motion(const dph_pose *pose, const double velocity[3], const double acceleration[3], const double jerk[3],
                     double joint_velocity[3], double joint_acceleration[3], double joint_jerk[3])
{
    for (int i = 0; i < 3; ++i) {
        const dph_arm *arm = &pose->arm[i];
        const double *s = pose->s[i];
        double s_d[3], s_dd[3];
        double inverse = 1.0 / dot(s, arm->elbow_d), e = dot(s, arm->elbow_dd);

        /* phi' = s . (p' - E' w) = 0 */
        double w = dot(s, velocity) * inverse;
        /* phi'' = |s'|^2 + s . (p'' - E' a - E'' w^2) = 0 */
        for (int k = 0; k < 3; ++k)
            s_d[k] = velocity[k] - w * arm->elbow_d[k];
        double a = (dot(s_d, s_d) + dot(s, acceleration) - e * w * w) * inverse;
        /* phi''' = 3 s' . s'' + s . (p''' - E' j - 3 E'' w a + E' w^3) = 0, since E''' = -E' */
        for (int k = 0; k < 3; ++k)
            s_dd[k] = acceleration[k] - a * arm->elbow_d[k] - w * w * arm->elbow_dd[k];
        joint_jerk[i] = (3.0 * dot(s_d, s_dd) + dot(s, jerk) - 3.0 * e * w * a) * inverse + w * w * w;
        joint_acceleration[i] = a;
        joint_velocity[i] = w;
    }
}

int dph_rates_at(const dph_robot *robot, const double point[3], const double first[3], const double second[3], dph_rates *rates)
{
    /* dph_pose_at and dph_pose_motion in the planes of the arms, x outwards and y beside: with cos and sin from the closure (upper_arm)
     * s . E' = La root, s . E'' = La (La - k). */
    double upper = robot->upper_arm_length, forearm = robot->forearm_length, half = 0.5 / upper, speed2 = dot(first, first), least = HUGE_VAL, s[3][3], normal[3];
    for (int i = 0; i < 3; ++i) {
        const double *u = arm_direction[i];
        double x = point[0] * u[0] + point[1] * u[1] + robot->platform_radius - robot->base_radius;
        double y = point[1] * u[0] - point[0] * u[1], z = point[2];
        double p2 = x * x + z * z, k = (p2 + upper * upper - (forearm - y) * (forearm + y)) * half;
        double root2 = p2 - k * k;
        if (!(root2 > 0.0) || !(fabs(y) <= forearm))
            return 0;
        double root = sqrt(root2), both = 1.0 / (p2 * root), scale = both * root, inverse = 2.0 * half * both * p2, c = scale * (x * k - z * root), d = -scale * (z * k + x * root);
        double along = x - upper * c, up = z + upper * d;

        double x1 = first[0] * u[0] + first[1] * u[1], y1 = first[1] * u[0] - first[0] * u[1], z1 = first[2];
        double x2 = second[0] * u[0] + second[1] * u[1], y2 = second[1] * u[0] - second[0] * u[1], z2 = second[2];
        double w = (along * x1 + y * y1 + up * z1) * inverse;
        double s1 = speed2 + upper * w * (2.0 * (d * x1 + c * z1) + upper * w); /* |s'|^2 */
        rates->q[0][i] = w;
        rates->q[1][i] = (s1 + along * x2 + y * y2 + up * z2 - upper * (upper - k) * w * w) * inverse;
        rates->direction[i][0] = c;
        rates->direction[i][1] = d;
        least = root < least ? root : least;
        s[i][0] = along * u[0] - y * u[1];
        s[i][1] = along * u[1] + y * u[0];
        s[i][2] = up;
    }
    cross(s[1], s[2], normal);
    double single = least / forearm, joint = fabs(dot(s[0], normal)) / (forearm * forearm * forearm);
    rates->dexterity = single < joint ? single : joint;
    return 1;
}

void dph_joint_motion(const dph_robot *robot, const double theta[3], const double point[3], const double velocity[3],
                      const double acceleration[3], const double jerk[3], double joint_velocity[3],
                      double joint_acceleration[3], double joint_jerk[3])
{
    dph_pose pose;
    pose_from(robot, theta, point, &pose);
    dph_pose_motion(&pose, velocity, acceleration, jerk, joint_velocity, joint_acceleration, joint_jerk);
}
