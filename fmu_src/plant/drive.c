/* One servo axis: the drive model of README.md. */
#include "drive.h"

#include <math.h>

static const double turn = 2.0 * 3.14159265358979323846;

/* Below this motor speed Coulomb friction is smooth, so that its slope stays slow against the integration step [rad/s]. */
static const double smooth_speed = 1.0;

static double limited(double x, double limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

Drive drive_from(const Variables *v)
{
    double velocity_gain = v->drive_nominal_inertia * turn * v->drive_velocity_bandwidth;
    Drive drive = {
        .gear_ratio = v->drive_gear_ratio,
        .gear_efficiency = v->drive_gear_efficiency,
        .coulomb = v->drive_coulomb_friction,
        .viscous = v->drive_viscous_friction,
        .torque_max = v->drive_torque_max,
        .torque_rated = v->drive_torque_rated,
        .warming = -expm1(-DRIVE_PERIOD / v->drive_thermal_time_constant),
        .speed_max = v->drive_speed_max,
        .quantum = turn / (double)v->drive_encoder_counts,
        .lag = {exp(-0.5 * DRIVE_PERIOD / v->drive_torque_time_constant), exp(-DRIVE_PERIOD / v->drive_torque_time_constant)},
        .position_gain = v->drive_position_gain,
        .velocity_gain = velocity_gain,
        .integral_gain = velocity_gain / v->drive_integral_time * DRIVE_PERIOD,
        .velocity_ff = v->drive_velocity_feedforward,
        .torque_ff = v->drive_torque_feedforward,
    };
    return drive;
}

/* Direction of motion, -1 to 1. */
static double direction(double speed)
{
    return tanh(speed / smooth_speed);
}

/* Friction [N m] at a motor speed. */
static double friction(const Drive *drive, double speed)
{
    return drive->coulomb * direction(speed) + drive->viscous * speed;
}

/* The gear loses (1 - efficiency) of the torque against the motion, whichever side drives: it never gives energy. */
double drive_joint_torque(const Drive *drive, double torque, double joint_velocity)
{
    double speed = drive->gear_ratio * joint_velocity;
    double loss = (1.0 - drive->gear_efficiency) * fabs(torque) * direction(speed);
    return drive->gear_ratio * (torque - loss - friction(drive, speed));
}

/* The inverse: motor torque that makes this torque on the joint side; the loss changes no signs. */
static double motor_torque(const Drive *drive, double joint_torque, double joint_velocity)
{
    double speed = drive->gear_ratio * joint_velocity;
    double passed = joint_torque / drive->gear_ratio + friction(drive, speed);
    return passed / (1.0 - (1.0 - drive->gear_efficiency) * copysign(direction(speed), passed * speed));
}

double axis_torque(const Drive *drive, const Axis *axis, int halves)
{
    return halves == 0 ? axis->torque : axis->command + (axis->torque - axis->command) * drive->lag[halves - 1];
}

void axis_start(const Drive *drive, Axis *axis, double joint_position, double joint_torque, double torque_ff)
{
    axis->zero = drive->gear_ratio * joint_position;
    axis->angle = axis->speed = 0.0;
    axis->torque = axis->command = limited(motor_torque(drive, joint_torque, 0.0), drive->torque_max);
    axis->integral = axis->command - drive->torque_ff * motor_torque(drive, torque_ff, 0.0);
}

void axis_read(const Drive *drive, Axis *axis, const Fault *fault, double joint_position)
{
    double before = axis->angle;
    if (!fault->encoder_stuck) {
        double turned = drive->gear_ratio * (joint_position + fault->encoder_offset) - axis->zero;
        axis->angle = drive->quantum * floor(turned / drive->quantum + 0.5);
    }
    axis->speed = (axis->angle - before) / DRIVE_PERIOD;
}

double axis_position(const Drive *drive, const Axis *axis)
{
    return (axis->zero + axis->angle) / drive->gear_ratio;
}

void axis_off(const Drive *drive, Axis *axis)
{
    axis->torque = axis_torque(drive, axis, 2);
    axis->command = 0.0;
    axis->integral = 0.0;
}

void axis_control(const Drive *drive, Axis *axis, const Fault *fault, const Reference *reference)
{
    double deviation = drive->gear_ratio * reference->position - axis->zero - axis->angle;
    double demand = drive->position_gain * deviation + drive->velocity_ff * drive->gear_ratio * reference->velocity;
    double error = limited(demand, drive->speed_max) - axis->speed;
    double forward = drive->torque_ff * motor_torque(drive, reference->torque, reference->velocity);
    double torque = drive->velocity_gain * error + axis->integral + forward;
    double given = limited(torque, fmin(drive->torque_max, fault->torque_limit));

    axis->torque = axis_torque(drive, axis, 2);
    axis->command = fault->torque_gain * given;
    /* Anti-windup: a saturated axis integrates only what brings it back. */
    if (torque == given || torque * error < 0.0)
        axis->integral += drive->integral_gain * error;
}
