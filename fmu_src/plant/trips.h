/* What makes the plant trip. A trip latches until the next initialization: drives off, brakes on. */
#ifndef TRIPS_H
#define TRIPS_H

#include "fmi/model.h"
#include "plant.h"

/* Look at drives and mechanism, as their sample sees them: trip for the first reason there is. `steps` is the time in steps. */
void trips_watch(Model *model, const Reference reference[3], double steps, const ModelLog *log);

/* The mechanism can go no further, and stands where it was. */
void trips_stop(Model *model, const dph_verdict *verdict, double steps, const ModelLog *log);

#endif
