/* DeltaPlanner: the model behind the FMU. */
#ifndef PLANNER_H
#define PLANNER_H

#include "feed.h"
#include "kernel/kernel.h"
#include "kernel/workspace.h"
#include "model_variables.h"

typedef struct {
    Variables v;
    dph_robot robot;
    double rest[3];       /* where the robot rests, or will once all accepted plans have run [m] */
    dph_setpoint standby; /* at rest, before the first plan */
    dph_plan running;     /* the last one begun; meaningful once has_run is set */
    dph_plan waiting;     /* or being planned */
    Feed feed;
    double elapsed_ms;    /* on the running plan's clock, from -dwell to its duration; whole numbers unless the feed has slowed it */
    double away;          /* of the pick point being planned from where the robot rests [m] */
    int32_t has_run, is_running, is_waiting, is_planning;
    int32_t last_trigger, last_cancel;
    dph_workspace workspace;
} Model;

#endif
