/* The paper's law, phases 1 to 6 (section 3.2): lift, quintic PH corner, half of the traverse, and their mirror image in space and time.
 * Each side has its own lift and corner; both meet at V_max in the middle of the traverse. */
#include <string.h>

#include "corner_law.h"
#include "laws.h"
#include "path.h"

/* Path length s and its time derivatives along a straight line, [order]. */
typedef double Line[4];

/* Phase 1, eq. (14): from rest to V_B, with T_1 = 2 j / V_B. */
static void lift_at(const dph_side *side, double t, Line s)
{
    double rate = 1.0 / side->lift_duration, f = t * rate, r = 1.0 - f;
    double s0 = side->lift_length, s1 = s0 * rate, s2 = s1 * rate, s3 = s2 * rate;
    s[0] = s0 * f * f * f * f * (5.0 + f * (2.0 * f - 6.0));
    s[1] = 2.0 * s1 * f * f * f * (10.0 + f * (6.0 * f - 15.0));
    s[2] = 60.0 * s2 * f * f * r * r;
    s[3] = 120.0 * s3 * f * r * (1.0 - 2.0 * f);
}

/* Phase 3, eq. (30): from V_B to V_max. */
static void cruise_at(const dph_side *side, double t, Line s)
{
    double rate = 1.0 / side->cruise_duration, f = t * rate, V = side->corner.entry_speed, rise = side->traverse_speed - V;
    s[0] = t * (V + rise * f * f * (1.0 - 0.5 * f));
    s[1] = V + rise * f * f * (3.0 - 2.0 * f);
    s[2] = 6.0 * rise * rate * f * (1.0 - f);
    s[3] = 6.0 * rise * rate * rate * (1.0 - 2.0 * f);
}

/* One side from rest; phase 0, 1, 2 is lift, corner, cruise; t counts from the phase's start. */
static void side_at(const dph_plan *plan, int place, int phase, double t, double d[4][2], double *arc_length)
{
    const dph_side *side = &plan->side[place];
    const dph_corner *corner = &side->corner.corner;
    double gamma;
    Line s;
    memset(d, 0, 4 * sizeof *d);
    switch (phase) {
    case 0:
        lift_at(side, t, s);
        for (int order = 0; order < 4; ++order)
            d[order][1] = s[order];
        *arc_length = s[0];
        break;
    case 1:
        dph_corner_law_gamma(&side->corner, 1, &t, &gamma, NULL);
        dph_corner_law_motion(&side->corner, gamma, d, arc_length);
        d[0][1] += side->lift_length;
        *arc_length += side->lift_length;
        break;
    default:
        cruise_at(side, t, s);
        d[0][0] = corner->second_leg;
        d[0][1] = side->lift_length + corner->leg;
        dph_path_along(plan, place, s, d);
        *arc_length = side->lift_length + corner->length + s[0];
        break;
    }
}

void dph_paper_at(const dph_plan *plan, int piece, double t, dph_planar *motion)
{
    if (piece < 3) {
        motion->side = 0;
        side_at(plan, 0, piece, t - plan->boundary[piece], motion->d, &motion->arc_length);
        return;
    }
    /* The place side, run backwards in time and mirrored: odd time derivatives change sign once, horizontal ones once more. */
    motion->side = 1;
    side_at(plan, 1, 5 - piece, plan->boundary[piece + 1] - t, motion->d, &motion->arc_length);
    motion->arc_length = plan->length - motion->arc_length;
    for (int order = 0; order < 4; ++order)
        motion->d[order][order % 2 == 0 ? 0 : 1] *= -1.0;
}

void dph_paper_move(dph_plan *plan)
{
    const dph_task *task = &plan->task;
    double duration[SEGMENTS];
    for (int which = 0; which < 2; ++which) {
        dph_side *side = &plan->side[which];
        dph_corner corner = side->corner.corner;
        /* Without a corner the traverse begins at rest: eq. (30) with V_B = 0. */
        double entry_speed = corner.length > 0.0 ? task->corner_entry_speed : 0.0;
        if (entry_speed > 0.0) {
            /* Equal corners are solved once (section 5, 2a). */
            if (which == 1 && memcmp(&corner, &plan->side[0].corner.corner, sizeof corner) == 0)
                side->corner = plan->side[0].corner;
            else
                dph_corner_law_make(&corner, entry_speed, task->corner_mid_speed, &side->corner);
            side->lift_duration = 2.0 * side->lift_length / entry_speed;
        }
        side->cruise_duration = 2.0 * side->cruise_length / (entry_speed + task->traverse_speed);
        side->traverse_speed = task->traverse_speed;
        duration[which == 0 ? 0 : 5] = side->lift_duration;
        duration[which == 0 ? 1 : 4] = side->corner.duration;
        duration[which == 0 ? 2 : 3] = side->cruise_duration;
    }
    plan->pieces = SEGMENTS;
    memcpy(plan->phase, dph_segment_phase, sizeof dph_segment_phase);
    memcpy(plan->arc_boundary, plan->segment_arc, sizeof plan->segment_arc);
    for (int piece = 0; piece < SEGMENTS; ++piece)
        plan->boundary[piece + 1] = plan->boundary[piece] + duration[piece];
}

dph_verdict dph_paper_make(dph_plan *plan)
{
    dph_verdict verdict = dph_path_make(plan);
    if (verdict.status == DPH_STATUS_OK)
        dph_paper_move(plan);
    return verdict;
}
