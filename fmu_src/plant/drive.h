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

/* The state of one axis. */
typedef struct {
    double zero;     /* angle at which the encoder began to count [rad] */
    double angle;    /* last reading, from zero [rad] */
    double integral; /* of the velocity loop [N m] */
    double torque;   /* of the motor at the last sample [N m] */
    double command;  /* what the torque loop has followed since [N m] */
} Axis;

Drive drive_from(const Variables *v);

/* Rest at a joint angle [rad] that takes a joint torque [N m] to hold, with a feed-forward torque [N m] already there. */
void axis_start(const Drive *drive, Axis *axis, double joint_position, double joint_torque, double torque_ff);

/* One sample: read the encoder, run position and velocity loop. */
void axis_sample(const Drive *drive, Axis *axis, const Reference *reference, double joint_position);

/* One sample with the drive switched off. */
void axis_off(const Drive *drive, Axis *axis);

/* Motor torque [N m] after so many half periods (0, 1, 2) since the last sample. */
double axis_torque(const Drive *drive, const Axis *axis, int halves);

/* Torque on the joint side [N m]: what is left of a motor torque after gear loss and friction. */
double drive_joint_torque(const Drive *drive, double torque, double joint_velocity);

#endif
