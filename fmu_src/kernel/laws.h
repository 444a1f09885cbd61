/* What a law of motion gives to the plan. */
#ifndef DELTAPH_LAWS_H
#define DELTAPH_LAWS_H

#include "kernel.h"
#include "workspace.h"

/* Motion in the vertical plane through pick and place, on the nominal clock. Horizontal distances count along the direction from pick to
 * place; both coordinates are relative to the pick point (side 0) or the place point (side 1), whichever makes the ends exact. */
typedef struct dph_planar {
    int side;
    double d[4][2];    /* [order][horizontal, vertical] */
    double arc_length; /* from the pick point [m] */
} dph_planar;

/* Refuse with facts; accept without; or leave it open. */
dph_verdict dph_refuse(dph_status status, dph_phase phase, int joint, double required, double available);
dph_verdict dph_accept(void);
dph_verdict dph_unfinished(void);

/* Fill in pieces, boundaries, lengths and deviations of a plan whose task is finite and positive and whose direction and traverse are
 * known; or refuse. */
dph_verdict dph_paper_make(dph_plan *plan);
dph_verdict dph_superposition_make(dph_plan *plan);

/* The same in slices: each call goes on where the last one stopped, until `units` have run out; then PLANNING. A search is zero where it begins.
 * dph_time_optimal_continue has also checked that the robot can follow the path. */
dph_verdict dph_paper_limited_continue(dph_search *search, dph_plan *plan, int *units);
void dph_time_optimal_begin(dph_workspace *workspace);
dph_verdict dph_time_optimal_continue(dph_workspace *workspace, dph_plan *plan, int *units);

/* The motion part of dph_paper_make, on a path that is laid. */
void dph_paper_move(dph_plan *plan);

/* Work of laying a path and its corners' quadratures, and of the comparison's strokes [units]. */
enum { DPH_CORNER_UNITS = 5, DPH_STROKES_UNITS = 45 };

/* The motion at nominal time t within a piece, one-sided at its boundaries. */
void dph_paper_at(const dph_plan *plan, int piece, double t, dph_planar *motion);
void dph_superposition_at(const dph_plan *plan, int piece, double t, dph_planar *motion);
void dph_time_optimal_at(const dph_plan *plan, int piece, double t, dph_planar *motion);

/* dph_superposition_at without arc length. */
void dph_superposition_motion(const dph_plan *plan, int piece, double t, dph_planar *motion);

/* Peaks of a plan in slices: 1 once they are complete. */
void dph_peaks_begin(dph_peak_search *search);
int dph_peaks_continue(const dph_plan *plan, dph_peak_search *search, int *units);
void dph_peaks_of(const dph_peak_search *search, dph_peaks *peaks);

/* Setpoint at an aligned time as seen from within one piece. */
void dph_plan_sample_piece(const dph_plan *plan, int piece, double time, dph_setpoint *setpoint);

#endif
