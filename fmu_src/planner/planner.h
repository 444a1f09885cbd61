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
    dph_plan waiting;
    Feed feed;
    double elapsed_ms;    /* on the running plan's clock, from -dwell to its duration; whole numbers unless the feed has slowed it */
    int32_t has_run, is_running, is_waiting;
    int32_t last_trigger;
} Model;

/* Memory behind the model that no state keeps: the workspace of the planner. */
enum { MODEL_SCRATCH = sizeof(dph_workspace) };

#endif
