/* The moving robot: rigid-body dynamics under drives and brakes. */
#ifndef MECHANISM_H
#define MECHANISM_H

#include "drive.h"
#include "kernel/kernel.h"

typedef struct {
    dph_robot robot;
    double payload;      /* [kg] */
    dph_motion motion;   /* at this instant */
    double brake_torque; /* of one brake, on the joint side [N m] */
    double brake_speed;  /* joint speed below which the brake is viscous instead [rad/s] */
    int32_t braked;
    int32_t locked;      /* at rest for good */
} Mechanism;

/* Rest at a joint position (3) with its point (3), held by motion.torque.
 * Fails: JOINT_RANGE or SINGULAR. */
dph_verdict mechanism_start(Mechanism *mechanism, const Drive *drive, const double theta[3], const double point[3]);

/* Recompute the motion after payload or brakes have changed. Fails: SINGULAR. */
dph_verdict mechanism_update(Mechanism *mechanism, const Drive *drive, const Axis axis[3], int halves);

/* Advance by DRIVE_PERIOD. Fails: JOINT_RANGE or SINGULAR; the motion then keeps its value. */
dph_verdict mechanism_advance(Mechanism *mechanism, const Drive *drive, const Axis axis[3]);

/* Are brakes on, and all joints so slow that they hold? */
int mechanism_is_caught(const Mechanism *mechanism);

/* Stand still from now on. */
void mechanism_lock(Mechanism *mechanism);

#endif
