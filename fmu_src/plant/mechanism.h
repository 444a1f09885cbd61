/* The moving robot: rigid-body dynamics under drives and brakes. */
#ifndef MECHANISM_H
#define MECHANISM_H

#include "drive.h"
#include "kernel/kernel.h"

typedef struct {
    dph_robot robot;
    double payload;         /* [kg] */
    double force[3];        /* from outside on the platform [N] */
    dph_motion motion;      /* at this instant */
    double brake_torque;    /* of one brake, on the joint side [N m] */
    double brake_speed;     /* joint speed below which the brake is viscous instead [rad/s] */
    double stop_stiffness;  /* of a hard stop [N m/rad] */
    double stop_damping;    /* [N m s/rad] */
    double stop_angle[2];   /* joint angles at which the hard stops begin [rad] */
    double joint_energy[3]; /* given to each joint since the start [J] */
    int32_t braked;
    int32_t locked;         /* held at rest */
} Mechanism;

/* Rest at a joint position (3) with its point (3), held by motion.torque. Robot, payload, force and hard stops are given.
 * Fails: JOINT_RANGE or SINGULAR. */
dph_verdict mechanism_start(Mechanism *mechanism, const Drive *drive, const double theta[3], const double point[3]);

/* Carry another payload [kg] from now on: what is added was at rest, what is let go flies on. Fails: SINGULAR. */
dph_verdict mechanism_load(Mechanism *mechanism, double payload);

/* Recompute the motion after payload, force or brakes have changed. Fails: SINGULAR. */
dph_verdict mechanism_update(Mechanism *mechanism, const Drive *drive, const Axis axis[3], int halves);

/* Advance by DRIVE_PERIOD.
 * Returned: motor_energy (3), given by each motor meanwhile [J].
 * Fails:    JOINT_RANGE or SINGULAR, the latter with dexterity 0 where there is no motion at all; the motion then keeps its value. */
dph_verdict mechanism_advance(Mechanism *mechanism, const Drive *drive, const Axis axis[3], double motor_energy[3]);

/* Are brakes on, all joints slow, and the brakes strong enough to hold them? */
int mechanism_is_caught(const Mechanism *mechanism);

/* Stand still. */
void mechanism_lock(Mechanism *mechanism);

#endif
