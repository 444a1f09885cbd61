/* What a motion costs a motor: heat, rms torque, work. */
#ifndef LOAD_H
#define LOAD_H

#include "drive.h"

/* Since the start. */
typedef struct {
    double thermal;     /* temperature rise in parts of that at the rated torque */
    double time;        /* that was counted [s] */
    double square;      /* integral of the squared torque [N^2 m^2 s] */
    double work;        /* given by the motor [J] */
    double regenerated; /* taken back [J] */
} Load;

/* Count a period of the drives in which the motor gave so much energy [J]; the axis is as after its sample. */
void load_add(const Drive *drive, const Axis *axis, double energy, Load *load);

#endif
