/* One servo axis: cascaded loops sampled every DRIVE_PERIOD, encoder, torque loop, friction and gear. Motor side unless said. */
#ifndef DRIVE_H
#define DRIVE_H

#include "model_variables.h"

/* Sampling period of the drives [s]. */
#define DRIVE_PERIOD 125e-6

/* What is the same for the three axes. */
typedef struct {
    double gear_ratio, gear_efficiency;
    double coulomb, viscous;   /* friction [N m], [N m s/rad] */
    double torque_max;         /* [N m] */
    double torque_rated;       /* [N m] */
    double warming;            /* share of the way to its final temperature that the motor goes in a period */
    double speed_max;          /* [rad/s] */
    double quantum;            /* of the encoder [rad] */
    double lag[2];             /* what is left of a torque step after half a period and after a whole one */
    double position_gain;      /* [1/s] */
    double velocity_gain;      /* [N m s/rad] */
    double integral_gain;      /* per sample [N m s/rad] */
    double velocity_ff, torque_ff;
} Drive;

/* Reference of one joint at one instant. */
typedef struct {
    double position, velocity; /* joint [rad], [rad/s] */
    double torque;             /* on the joint side, rigid robot [N m] */
} Reference;

/* What may go wrong with an axis; without faults the limit is infinite, the gain 1, the rest 0. */
typedef struct {
    double torque_limit;   /* [N m] */
    double torque_gain;    /* share of its torque that the motor gives */
    double encoder_offset; /* joint angle by which the encoder reads too much [rad] */
    int32_t encoder_stuck;
} Fault;

/* The state of one axis. */
typedef struct {
    double zero;     /* angle at which the encoder began to count [rad] */
    double angle;    /* last reading, from zero [rad] */
    double speed;    /* difference of the last two readings over the period [rad/s] */
    double integral; /* of the velocity loop [N m] */
    double torque;   /* of the motor at the last sample [N m] */
    double command;  /* what the torque loop has followed since [N m] */
} Axis;

Drive drive_from(const Variables *v);

/* Rest at a joint angle [rad] that takes a joint torque [N m] to hold, with a feed-forward torque [N m] already there. */
void axis_start(const Drive *drive, Axis *axis, double joint_position, double joint_torque, double torque_ff);

/* One sample begins: read the encoder. */
void axis_read(const Drive *drive, Axis *axis, const Fault *fault, double joint_position);

/* Joint angle [rad] by the last reading. */
double axis_position(const Drive *drive, const Axis *axis);

/* The sample goes on: run position and velocity loop. */
void axis_control(const Drive *drive, Axis *axis, const Fault *fault, const Reference *reference);

/* The same with the drive switched off. */
void axis_off(const Drive *drive, Axis *axis);

/* Motor torque [N m] after so many half periods (0, 1, 2) since the last sample. */
double axis_torque(const Drive *drive, const Axis *axis, int halves);

/* Torque on the joint side [N m]: what is left of a motor torque after gear loss and friction. */
double drive_joint_torque(const Drive *drive, double torque, double joint_velocity);

#endif
