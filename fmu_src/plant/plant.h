/* DeltaPlant: the model behind the FMU. */
#ifndef PLANT_H
#define PLANT_H

#include "drive.h"
#include "load.h"
#include "mechanism.h"
#include "model_variables.h"

typedef struct {
    Variables v;
    Drive drive;
    Axis axis[3];
    Fault fault[3];
    Load load[3];
    Mechanism mechanism;
    uint64_t steps; /* done since the start */
} Model;

#endif
