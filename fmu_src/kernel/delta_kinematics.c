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

/* Where the platform joint of arm i is, from its shoulder: outwards, beside, up [m]. */
static inline void joint_at(const dph_robot *robot, int i, const double point[3], double joint[3])
{
    const double *u = arm_direction[i];
    joint[0] = point[0] * u[0] + point[1] * u[1] + (robot->platform_radius - robot->base_radius);
    joint[1] = point[1] * u[0] - point[0] * u[1];
    joint[2] = point[2];
}

/* Does arm i reach: is the distance from shoulder to platform joint in the arm's plane within its bounds? */
static dph_verdict reach_check(const dph_robot *robot, int i, const double point[3])
{
    double upper = robot->upper_arm_length, forearm = robot->forearm_length, joint[3];
    joint_at(robot, i, point, joint);
    double y = joint[1];
    if (!(fabs(y) <= forearm)) /* the forearm cannot even lean that far */
        return unreachable(i, fabs(y), forearm);
    double plane = sqrt(joint[0] * joint[0] + joint[2] * joint[2]), lean = sqrt((forearm - y) * (forearm + y));
    if (!(plane <= upper + lean))
        return unreachable(i, plane, upper + lean);
    if (!(plane >= fabs(upper - lean)))
        return unreachable(i, plane, fabs(upper - lean));
    return dph_accept();
}

/* What follows from cos, sin and the platform joint: the forearm in the base frame. */
static inline void lay_forearm(int i, const double joint[3], double upper, dph_limb *limb)
{
    const double *u = arm_direction[i];
    double out = joint[0] - upper * limb->cosine;
    limb->s[0] = out * u[0] - joint[1] * u[1];
    limb->s[1] = out * u[1] + joint[1] * u[0];
    limb->s[2] = joint[2] + upper * limb->sine;
}

/* One joint; inverse_upper is 1 / La. The closure x cos - z sin = K := (x^2 + z^2 + La^2 + y^2 - l^2) / (2 La) has two solutions; with the
 * minus branch, the smaller angle, the elbow is outwards. They are real where K^2 <= x^2 + z^2, which is within the bounds of reach_check.
 * Returned: are they? */
static inline int limb_at(const dph_robot *robot, int i, const double point[3], double inverse_upper, dph_limb *limb)
{
    double upper = robot->upper_arm_length, forearm = robot->forearm_length, joint[3];
    joint_at(robot, i, point, joint);
    double x = joint[0], y = joint[1], z = joint[2], plane2 = x * x + z * z, lean2 = (forearm - y) * (forearm + y);
    double k = 0.5 * inverse_upper * (plane2 + (upper * upper - lean2)), root2 = plane2 - k * k;
    int is_real = root2 >= 0.0 && lean2 >= 0.0;
    double root = is_real ? sqrt(root2) : 0.0;
    /* A platform joint on its shoulder leaves the angle open: as atan2 has it, 0. */
    double scale = plane2 > 0.0 ? 1.0 / plane2 : 0.0;
    limb->cosine = plane2 > 0.0 ? scale * (x * k - z * root) : 1.0;
    limb->sine = -scale * (z * k + x * root);
    limb->along = k;
    limb->across = root;
    lay_forearm(i, joint, upper, limb);
    return is_real;
}

dph_verdict dph_pose_at(const dph_robot *robot, const double point[3], dph_pose *pose)
{
    double inverse_upper = 1.0 / robot->upper_arm_length;
    pose->upper = robot->upper_arm_length;
    for (int i = 0; i < 3; ++i) {
        if (limb_at(robot, i, point, inverse_upper, &pose->limb[i]))
            continue;
        dph_verdict verdict = reach_check(robot, i, point); /* within its bounds it is at one of them, but for rounding */
        if (verdict.status != DPH_STATUS_OK)
            return verdict;
    }
    return dph_accept();
}

void dph_pose_from(const dph_robot *robot, const double theta[3], const double point[3], dph_pose *pose)
{
    pose->upper = robot->upper_arm_length;
    for (int i = 0; i < 3; ++i) {
        dph_limb *limb = &pose->limb[i];
        double joint[3];
        joint_at(robot, i, point, joint);
        limb->cosine = cos(theta[i]);
        limb->sine = sin(theta[i]);
        limb->along = joint[0] * limb->cosine - joint[2] * limb->sine;
        limb->across = -(joint[0] * limb->sine + joint[2] * limb->cosine);
        lay_forearm(i, joint, pose->upper, limb);
    }
}

/* The angle of a unit vector, as atan2 has it, in a third of its time and with the same bits whatever the libm. Within the first octant the
 * sine chooses the nearest angle phi of a table, sin phi = k/16; what is left has the sine u = sin cos phi - cos sin phi, |u| < 0.045, and
 * of the series of its arc sine the first term that is left out is below 2e-18 u. */
static double angle_of(double cosine, double sine)
{
    static const double table_cosine[12] = {
        1.0, 0.99804496391695699994, 0.99215674164922147144, 0.98226460284385693626, 0.96824583655185422129,
        0.94991775959816647698, 0.92702481088695786859, 0.89921841062113491405, 0.86602540378443864676, 0.82679728470768455953,
        0.78062474979979977573, 0.72618437741389066597,
    };
    static const double table_angle[12] = {
        0.0, 0.062540761796491390801, 0.12532783116806539687, 0.18861638617540409611, 0.25268025514207865349,
        0.31782370392788075318, 0.38439677449563908304, 0.45281659474492557164, 0.52359877559829887308, 0.5974064166453502143,
        0.67513153293703164721, 0.75804076542623596046,
    };
    double s = fabs(sine), c = fabs(cosine);
    int is_steep = s > c;
    double low = is_steep ? c : s, high = is_steep ? s : c;
    int k = low < 0.7 ? (int)(16.0 * low + 0.5) : 11; /* also of what is no number */
    double u = low * table_cosine[k] - high * (k / 16.0), u2 = u * u, u4 = u2 * u2;
    double rest = u * u2 * ((1.0 / 6.0 + u2 * (3.0 / 40.0)) + u4 * ((5.0 / 112.0 + u2 * (35.0 / 1152.0)) + u4 * (63.0 / 2816.0)));
    double theta = table_angle[k] + (u + rest);
    if (is_steep)
        theta = half_turn / 2.0 - theta;
    if (cosine < 0.0)
        theta = half_turn - theta;
    return copysign(theta, sine);
}

void dph_pose_angles(const dph_pose *pose, double theta[3])
{
    for (int i = 0; i < 3; ++i)
        theta[i] = angle_of(pose->limb[i].cosine, pose->limb[i].sine);
}

dph_verdict dph_inverse_kinematics(const dph_robot *robot, const double point[3], double theta[3])
{
    dph_pose pose;
    dph_verdict verdict = dph_pose_at(robot, point, &pose);
    if (verdict.status == DPH_STATUS_OK)
        dph_pose_angles(&pose, theta);
    return verdict;
}

int dph_forward_kinematics(const dph_robot *robot, const double theta[3], double point[3])
{
    dph_arm arm[3];
    for (int i = 0; i < 3; ++i)
        arm_at(robot, i, theta[i], &arm[i]);
    return platform_below(robot, arm, point);
}

void dph_pose_dexterities(const dph_robot *robot, const dph_pose *pose, double aligned[3], double *coplanar)
{
    double normal[3], forearm = robot->forearm_length;
    for (int i = 0; i < 3; ++i)
        aligned[i] = fabs(pose->limb[i].across) / forearm;
    cross(pose->limb[1].s, pose->limb[2].s, normal);
    *coplanar = fabs(dot(pose->limb[0].s, normal)) / (forearm * forearm * forearm);
}

double dph_dexterity(const dph_robot *robot, const double theta[3], const double point[3])
{
    dph_pose pose;
    double aligned[3], coplanar;
    dph_pose_from(robot, theta, point, &pose);
    dph_pose_dexterities(robot, &pose, aligned, &coplanar);
    return fmin(fmin(aligned[0], aligned[1]), fmin(aligned[2], coplanar));
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

/* Without the jerk where that is NULL. */
static inline void motion_at(const dph_pose *pose, const double velocity[3], const double acceleration[3], const double *jerk,
                             double joint_velocity[3], double joint_acceleration[3], double *joint_jerk)
{
    double upper = pose->upper, upper2 = upper * upper, p11 = dot(velocity, velocity), p12 = dot(velocity, acceleration);
    for (int i = 0; i < 3; ++i) {
        const dph_limb *limb = &pose->limb[i];
        const double *u = arm_direction[i], *s = limb->s;
        double inverse = 1.0 / (upper * limb->across), e = upper * (upper - limb->along);
        double across1 = velocity[0] * u[0] + velocity[1] * u[1], across2 = acceleration[0] * u[0] + acceleration[1] * u[1];
        /* E' . p' = -v1, E'' . p' = -n1, E' . p'' = -v2 */
        double v1 = upper * (limb->sine * across1 + limb->cosine * velocity[2]);
        double n1 = upper * (limb->cosine * across1 - limb->sine * velocity[2]);
        double v2 = upper * (limb->sine * across2 + limb->cosine * acceleration[2]);

        /* phi' = s . (p' - E' w) = 0 */
        double w = dot(s, velocity) * inverse;
        /* phi'' = |s'|^2 + s . (p'' - E' a - E'' w^2) = 0, s' = p' - E' w */
        double s11 = p11 + w * (2.0 * v1 + upper2 * w);
        double a = (s11 + dot(s, acceleration) - e * w * w) * inverse;
        joint_velocity[i] = w;
        joint_acceleration[i] = a;
        if (!jerk)
            continue;

        /* phi''' = 3 s' . s'' + s . (p''' - E' j - 3 E'' w a + E' w^3) = 0, s'' = p'' - E' a - E'' w^2, since E''' = -E' */
        double s12 = p12 + a * v1 + w * (v2 + w * n1 + upper2 * a);
        joint_jerk[i] = (3.0 * (s12 - e * w * a) + dot(s, jerk)) * inverse + w * w * w;
    }
}

void dph_pose_motion(const dph_pose *pose, const double velocity[3], const double acceleration[3], const double jerk[3],
                     double joint_velocity[3], double joint_acceleration[3], double joint_jerk[3])
{
    motion_at(pose, velocity, acceleration, jerk, joint_velocity, joint_acceleration, joint_jerk);
}

void dph_pose_acceleration(const dph_pose *pose, const double velocity[3], const double acceleration[3], double joint_velocity[3],
                           double joint_acceleration[3])
{
    motion_at(pose, velocity, acceleration, NULL, joint_velocity, joint_acceleration, NULL);
}

int dph_rates_at(const dph_robot *robot, const double point[3], const double first[3], const double second[3], dph_rates *rates)
{
    /* dph_pose_at and dph_pose_motion in the planes of the arms, x outwards and y beside: with cos and sin from the closure (upper_arm)
     * s . E' = La root, s . E'' = La (La - k). */
    double upper = robot->upper_arm_length, forearm = robot->forearm_length, half = 0.5 / upper, speed2 = dot(first, first), least = HUGE_VAL, s[3][3], normal[3];
    for (int i = 0; i < 3; ++i) {
        const double *u = arm_direction[i];
        double x = point[0] * u[0] + point[1] * u[1] + (robot->platform_radius - robot->base_radius);
        double y = point[1] * u[0] - point[0] * u[1], z = point[2];
        double p2 = x * x + z * z, k = (p2 + (upper * upper - (forearm - y) * (forearm + y))) * half;
        double root2 = p2 - k * k;
        if (!(root2 > 0.0) || !(fabs(y) <= forearm))
            return 0;
        double root = sqrt(root2), scale = 1.0 / p2, inverse = 1.0 / (upper * root);
        double c = scale * (x * k - z * root), d = -scale * (z * k + x * root);
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
    dph_pose_from(robot, theta, point, &pose);
    dph_pose_motion(&pose, velocity, acceleration, jerk, joint_velocity, joint_acceleration, joint_jerk);
}
