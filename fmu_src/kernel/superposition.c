/* The comparison method: motion superposition (paper eq. (31)). Two vertical strokes and a horizontal one, each a quintic in time; the
 * horizontal stroke overlaps a share of each vertical one. The paper gives the upward half; the downward one is its mirror image. */
#include <math.h>
#include <string.h>

#include "laws.h"
#include "quadrature.h"

/* Greatest speed of a quintic stroke is 15/8 of its mean speed. */
static const double peak_factor = 1.875;

/* A traverse below is none: its duration would be lost in rounding next to those of the lifts. */
static const double least_traverse = 1e-9;

/* Stroke of unit length and duration T at time t, with its time derivatives: 6 f^5 - 15 f^4 + 10 f^3. */
static void stroke_at(double T, double t, double s[4])
{
    double f = t / T, r = 1.0 - f;
    s[0] = f * f * f * (10.0 + f * (6.0 * f - 15.0));
    s[1] = 30.0 / T * f * f * r * r;
    s[2] = 60.0 / (T * T) * f * r * (1.0 - 2.0 * f);
    s[3] = 60.0 / (T * T * T) * (1.0 + 6.0 * f * (f - 1.0));
}

static double stroke_duration(double length, double speed)
{
    return peak_factor * length / speed;
}

/* Motion without arc length. Pieces: lift, overlap, traverse, overlap, lower; those after the middle are the mirror image of their
 * counterparts, run backwards in time from the place point. */
void dph_superposition_motion(const dph_plan *plan, int piece, double t, dph_planar *motion)
{
    double end = plan->boundary[5], s[4];
    int place = piece > 2 || (piece == 2 && t > 0.5 * end);
    memset(motion->d, 0, sizeof motion->d);
    motion->side = place;

    double start = plan->boundary[1], stop = plan->boundary[4];
    if (piece >= 1 && piece <= 3) {
        stroke_at(stop - start, place ? stop - t : t - start, s);
        for (int order = 0; order < 4; ++order)
            motion->d[order][0] = plan->traverse * s[order] * (place && order % 2 == 0 ? -1.0 : 1.0);
    }
    if (piece == 2) {
        motion->d[0][1] = plan->task.lift[place];
    } else {
        stroke_at(place ? end - plan->boundary[3] : plan->boundary[2], place ? end - t : t, s);
        for (int order = 0; order < 4; ++order)
            motion->d[order][1] = plan->task.lift[place] * s[order] * (place && order % 2 == 1 ? -1.0 : 1.0);
    }
}

typedef struct Piece {
    const dph_plan *plan;
    int piece;
} Piece;

static double speed(double t, const void *context)
{
    const Piece *piece = context;
    dph_planar motion;
    dph_superposition_motion(piece->plan, piece->piece, t, &motion);
    return hypot(motion.d[1][0], motion.d[1][1]);
}

/* Four panels: the integrand of an overlap is smooth, but its complex singularities lie about a quarter of it away. */
static double arc_length(const dph_plan *plan, int piece, double from, double to)
{
    enum { PANELS = 4 };
    Piece context = {plan, piece};
    double sum = 0.0, width = (to - from) / PANELS;
    for (int i = 0; i < PANELS; ++i)
        sum += gauss_integral(speed, &context, from + width * i, from + width * (i + 1));
    return sum;
}

void dph_superposition_at(const dph_plan *plan, int piece, double t, dph_planar *motion)
{
    dph_superposition_motion(plan, piece, t, motion);
    /* From the nearer end of the piece, so that both ends are exact. */
    double begin = plan->boundary[piece], end = plan->boundary[piece + 1];
    motion->arc_length = t < 0.5 * (begin + end) ? plan->arc_boundary[piece] + arc_length(plan, piece, begin, t)
                                                 : plan->arc_boundary[piece + 1] - arc_length(plan, piece, t, end);
}

/* Half the time derivative of the squared distance to the vertex in the overlap `piece`. */
static double approach(const dph_plan *plan, int piece, double t, double *distance)
{
    dph_planar motion;
    dph_superposition_motion(plan, piece, t, &motion);
    double x = motion.d[0][0], z = motion.d[0][1] - plan->task.lift[motion.side];
    *distance = hypot(x, z);
    return x * motion.d[1][0] + z * motion.d[1][1];
}

/* Closest approach to a vertex: the closest of a scan, refined by bisection of the derivative to the last bit. */
static double corner_deviation(const dph_plan *plan, int piece)
{
    enum { SCAN = 64 };
    double begin = plan->boundary[piece], width = plan->boundary[piece + 1] - begin, least = INFINITY, distance = 0.0;
    int nearest = 0;
    for (int i = 0; i <= SCAN; ++i) {
        approach(plan, piece, begin + width * i / SCAN, &distance);
        if (distance < least) {
            least = distance;
            nearest = i;
        }
    }
    double low = begin + width * (nearest > 0 ? nearest - 1 : 0) / SCAN;
    double high = begin + width * (nearest < SCAN ? nearest + 1 : SCAN) / SCAN;
    for (int i = 0; i < 60; ++i) {
        double middle = 0.5 * (low + high);
        if (approach(plan, piece, middle, &distance) < 0.0)
            low = middle;
        else
            high = middle;
        if (distance < least)
            least = distance;
    }
    return least;
}

dph_verdict dph_superposition_make(dph_plan *plan)
{
    static const dph_phase phase[5] = {DPH_PHASE_LIFT, DPH_PHASE_PICK_CORNER, DPH_PHASE_TRAVERSE, DPH_PHASE_PLACE_CORNER,
                                       DPH_PHASE_LOWER};
    const dph_task *task = &plan->task;
    double up = stroke_duration(task->lift[0], task->corner_entry_speed);
    double down = stroke_duration(task->lift[1], task->corner_entry_speed);
    double across = stroke_duration(plan->traverse, task->traverse_speed);
    double overlaps = task->overlap * (up + down);
    if (!(across >= overlaps) || !(plan->traverse >= least_traverse))
        return dph_refuse(DPH_STATUS_TRAVERSE_TOO_SHORT, DPH_PHASE_IDLE, 0,
                          fmax(overlaps * task->traverse_speed / peak_factor, least_traverse), plan->traverse);

    plan->pieces = 5;
    memcpy(plan->phase, phase, sizeof phase);
    double *b = plan->boundary;
    b[1] = (1.0 - task->overlap) * up;
    b[2] = up;
    b[4] = b[1] + across;
    b[3] = b[4] - task->overlap * down;
    b[5] = b[3] + down;
    for (int piece = 0; piece < plan->pieces; ++piece)
        plan->arc_boundary[piece + 1] = plan->arc_boundary[piece] + arc_length(plan, piece, b[piece], b[piece + 1]);
    plan->corner_deviation[0] = corner_deviation(plan, 1);
    plan->corner_deviation[1] = corner_deviation(plan, 3);
    return dph_accept();
}
