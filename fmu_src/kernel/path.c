/* The path of a PPO: up, around a quintic PH corner, across, around another one, down. By arc length, and by the parameter x of the
 * time-optimal law. The place side is the mirror image of a pick side: it is measured from the place point. */
#include "path.h"

#include <math.h>
#include <string.h>

#include "corner_law.h"
#include "laws.h"

const dph_phase dph_segment_phase[SEGMENTS] = {DPH_PHASE_LIFT,       DPH_PHASE_PICK_CORNER,  DPH_PHASE_ACCELERATE,
                                               DPH_PHASE_DECELERATE, DPH_PHASE_PLACE_CORNER, DPH_PHASE_LOWER};

/* Bounds of a bounded corner. Of a straight that begins or ends at rest it takes at most a share: the motion has to gather speed before it
 * bends, the paper's law all of V_B. Its longer leg is at most so many times the other. ../planner/README.md, section Path, says what both
 * are worth; 0.6 would be faster than 0.71 for paper_limited, but the paper's own corner, 0.703 of its lift, is to stay what it is. */
typedef struct Bounds {
    double share, ratio;
} Bounds;

static const Bounds of_paper_limited = {0.71, 1.5}, of_time_optimal = {0.9, 6.0};

/* The shortest traverse with a bounded corner [m], below which its deviation would be nothing that a robot can do; and what is none. */
static const double least_traverse = 1e-6, no_traverse = 1e-9;

/* A straight between the corners that is shorter than this share of the traverse is rounding. */
static const double least_share = 1e-12;

/* Of what is asked for, does the deviation hold exactly, as printed in the paper, or is it an upper bound? */
static int is_bounded(dph_law law)
{
    return law == DPH_LAW_PAPER_LIMITED || law == DPH_LAW_TIME_OPTIMAL;
}

/* The corner within the room there is along lift and traverse. Its legs are equal where both have room; where one has not, the other one is
 * longer, so that the deviation is what was asked for; where that has no room either, the deviation is smaller. */
static void lay_bounded_corner(double deviation, const double room[2], double ratio, dph_corner *corner)
{
    int shorter = room[1] < room[0];
    if (dph_corner_leg(deviation) <= room[shorter]) {
        dph_corner_from_deviation(deviation, corner);
        return;
    }
    double leg[2];
    leg[shorter] = room[shorter];
    leg[1 - shorter] = fmin(room[1 - shorter], dph_corner_longer_leg(leg[shorter], deviation, ratio * leg[shorter]));
    dph_corner_from_legs(leg[0], leg[1], corner);
}

/* Corners with the deviation as an upper bound, none on a side without lift. Each may take half of the traverse, and what the other one
 * leaves. */
static dph_verdict lay_bounded_corners(dph_plan *plan)
{
    const dph_task *task = &plan->task;
    const Bounds *bounds = task->law == DPH_LAW_PAPER_LIMITED ? &of_paper_limited : &of_time_optimal;
    int has_corner[2] = {task->lift[0] > 0.0, task->lift[1] > 0.0};
    if (!(plan->traverse >= least_traverse)) {
        /* Straight up or straight down. Up and down again along one line would be a stop on the way, and so two PPOs. */
        if (has_corner[0] == has_corner[1] || plan->traverse > no_traverse)
            return dph_refuse(DPH_STATUS_TRAVERSE_TOO_SHORT, DPH_PHASE_IDLE, 0, least_traverse, plan->traverse);
        plan->middle[0] = 0.0;
        plan->middle[1] = has_corner[0] ? 1.0 : -1.0;
        return dph_accept();
    }
    double whole = has_corner[0] && has_corner[1] ? plan->traverse : bounds->share * plan->traverse, wanted[2];
    for (int pass = 0; pass < 2; ++pass) {
        for (int which = 0; which < 2; ++which) {
            if (!has_corner[which])
                continue;
            dph_corner *corner = &plan->side[which].corner.corner;
            int shares = pass > 0 && has_corner[1 - which];
            double room[2] = {bounds->share * task->lift[which], shares ? fmax(0.5 * whole, whole - wanted[1 - which]) : whole};
            lay_bounded_corner(task->corner_deviation[which], room, bounds->ratio, corner);
            if (corner->deviation < (1.0 - 1e-9) * task->corner_deviation[which])
                plan->corner_bound[which] = (corner->leg == room[0] ? 1 : 0) + (corner->second_leg == room[1] ? 2 : 0);
        }
        for (int which = 0; which < 2; ++which)
            wanted[which] = plan->side[which].corner.corner.second_leg;
    }
    return dph_accept();
}

/* Corners with equal legs and exactly the deviation that is asked for. */
static dph_verdict lay_exact_corners(dph_plan *plan)
{
    for (int which = 0; which < 2; ++which) {
        dph_corner *corner = &plan->side[which].corner.corner;
        double lift = plan->task.lift[which];
        dph_corner_from_deviation(plan->task.corner_deviation[which], corner);
        /* A lift is left that the clock can tell from none. */
        if (!(corner->leg <= (1.0 - 1e-9) * lift))
            return dph_refuse(DPH_STATUS_LIFT_TOO_LOW, which == 0 ? DPH_PHASE_PICK_CORNER : DPH_PHASE_PLACE_CORNER, 0,
                              corner->deviation, lift * (corner->deviation / corner->leg));
    }
    double legs = plan->side[0].corner.corner.second_leg + plan->side[1].corner.corner.second_leg;
    if (!(legs <= plan->traverse))
        return dph_refuse(DPH_STATUS_TRAVERSE_TOO_SHORT, DPH_PHASE_IDLE, 0, legs, plan->traverse);
    return dph_accept();
}

dph_verdict dph_path_make(dph_plan *plan)
{
    const dph_task *task = &plan->task;
    plan->middle[0] = 1.0;
    dph_verdict verdict = is_bounded(task->law) ? lay_bounded_corners(plan) : lay_exact_corners(plan);
    if (verdict.status != DPH_STATUS_OK)
        return verdict;

    int is_level = plan->middle[0] > 0.0;
    double legs = plan->side[0].corner.corner.second_leg + plan->side[1].corner.corner.second_leg;
    double straight = is_level ? plan->traverse - legs : task->lift[0] + task->lift[1];
    if (straight < least_share * plan->traverse)
        straight = 0.0;

    double length[SEGMENTS];
    for (int which = 0; which < 2; ++which) {
        dph_side *side = &plan->side[which];
        side->lift_length = is_level ? task->lift[which] - side->corner.corner.leg : 0.0;
        side->cruise_length = 0.5 * straight;
        plan->corner_deviation[which] = side->corner.corner.deviation;
        length[which == 0 ? 0 : 5] = side->lift_length;
        length[which == 0 ? 1 : 4] = side->corner.corner.length;
        length[which == 0 ? 2 : 3] = side->cruise_length;
    }
    for (int segment = 0; segment < SEGMENTS; ++segment)
        plan->segment_arc[segment + 1] = plan->segment_arc[segment] + length[segment];
    plan->length = plan->segment_arc[SEGMENTS];
    return dph_accept();
}

/* Arc lengths from the nearer end at which segments 0, 1, 2 of a side end. */
static double segment_end(const dph_side *side, int part)
{
    return side->lift_length + (part > 0 ? side->corner.corner.length : 0.0) + (part > 1 ? side->cruise_length : 0.0);
}

static int is_empty(const dph_side *side, int part)
{
    return !((part == 0 ? side->lift_length : part == 1 ? side->corner.corner.length : side->cruise_length) > 0.0);
}

int dph_path_segment(const dph_plan *plan, int segment, double length)
{
    const dph_side *side = &plan->side[segment < 3 ? 0 : 1];
    int part = segment < 3 ? segment : 5 - segment;
    /* One-sided at a segment's end, but for rounding. */
    double rounding = 1e-12 * plan->length;
    while (part < 2 && (length > segment_end(side, part) + rounding || is_empty(side, part)))
        ++part;
    while (part > 0 && (length < segment_end(side, part - 1) - rounding || is_empty(side, part)))
        --part;
    return segment < 3 ? part : 5 - part;
}

void dph_path_along(const dph_plan *plan, int place, const double s[4], double d[4][2])
{
    for (int order = 0; order < 4; ++order) {
        d[order][0] += s[order] * plan->middle[0];
        d[order][1] += s[order] * (place ? -plan->middle[1] : plan->middle[1]);
    }
}

void dph_path_at(const dph_plan *plan, int segment, double length, double d[4][2])
{
    static const double unit_speed[3] = {1.0, 0.0, 0.0};
    double on_line[4] = {0.0, 1.0, 0.0, 0.0};
    const dph_side *side = &plan->side[segment < 3 ? 0 : 1];
    const dph_corner *corner = &side->corner.corner;
    double on_corner, past = length - side->lift_length;
    memset(d, 0, 4 * sizeof *d);
    switch (segment < 3 ? segment : 5 - segment) {
    case 0:
        d[0][1] = length;
        d[1][1] = 1.0;
        break;
    case 1:
        dph_corner_motion(corner, dph_corner_gamma(corner, past), unit_speed, d, &on_corner);
        d[0][1] += side->lift_length;
        break;
    default:
        d[0][0] = corner->second_leg;
        d[0][1] = side->lift_length + corner->leg;
        on_line[0] = past - corner->length;
        dph_path_along(plan, segment >= 3, on_line, d);
        break;
    }
    /* The place side is run the other way and mirrored: odd derivatives change sign once, horizontal ones once more. */
    if (segment >= 3)
        for (int order = 0; order < 4; ++order)
            d[order][order % 2 == 0 ? 0 : 1] *= -1.0;
}

void dph_parameter_at(double x, double y[4])
{
    double r = 1.0 - x;
    y[0] = x * x * x * (10.0 + x * (6.0 * x - 15.0));
    y[1] = 30.0 * x * x * r * r;
    y[2] = 60.0 * x * r * (1.0 - 2.0 * x);
    y[3] = 60.0 * (1.0 - 6.0 * x * r);
}

double dph_parameter_of(double share)
{
    if (!(share > 0.0) || !(share < 1.0))
        return share > 0.0 ? 1.0 : 0.0;
    double low = 0.0, high = 1.0, x = 0.5, y[4];
    /* Newton's method within a shrinking bracket; y' vanishes at both ends. */
    for (int i = 0; i < 100 && high - low > 1e-16; ++i) {
        dph_parameter_at(x, y);
        if (y[0] > share)
            high = x;
        else
            low = x;
        double next = x - (y[0] - share) / y[1];
        next = next >= low && next <= high ? next : 0.5 * (low + high);
        if (next == x)
            break;
        x = next;
    }
    return x;
}

void dph_path_by_parameter(const dph_plan *plan, int segment, double x, double d[4][2], double *ds, double *arc_length)
{
    /* From the nearer end, so that both ends are exact. */
    double y[4], by_arc[4][2];
    int place = segment >= 3;
    dph_parameter_at(place ? 1.0 - x : x, y);
    double length = plan->length * y[0];
    segment = dph_path_segment(plan, segment, length);
    dph_path_at(plan, segment, length, by_arc);

    double s1 = plan->length * y[1], s2 = plan->length * y[2] * (place ? -1.0 : 1.0), s3 = plan->length * y[3];
    for (int i = 0; i < 2; ++i) {
        d[0][i] = by_arc[0][i];
        d[1][i] = by_arc[1][i] * s1;
        d[2][i] = by_arc[2][i] * s1 * s1 + by_arc[1][i] * s2;
        d[3][i] = by_arc[3][i] * s1 * s1 * s1 + 3.0 * by_arc[2][i] * s1 * s2 + by_arc[1][i] * s3;
    }
    *ds = s1;
    *arc_length = place ? plan->length - length : length;
}

void dph_path_walk(const dph_plan *plan, int segment, double x, dph_corner_walk *walk, double d[3][2], double *ds, double *length)
{
    double y[4], frame[3][2] = {{0.0}};
    int place = segment >= 3;
    const dph_side *side = &plan->side[place];
    dph_parameter_at(place ? 1.0 - x : x, y);
    double arc = plan->length * y[0], past = arc - side->lift_length;
    switch (place ? 5 - segment : segment) {
    case 0:
        frame[0][1] = arc;
        frame[1][1] = 1.0;
        break;
    case 1:
        dph_corner_frame(&side->corner.corner, past, walk, frame);
        frame[0][1] += side->lift_length;
        break;
    default:
        past -= side->corner.corner.length;
        frame[0][0] = side->corner.corner.second_leg + past * plan->middle[0];
        frame[0][1] = side->lift_length + side->corner.corner.leg + past * (place ? -plan->middle[1] : plan->middle[1]);
        frame[1][0] = plan->middle[0];
        frame[1][1] = place ? -plan->middle[1] : plan->middle[1];
        break;
    }
    double s1 = plan->length * y[1], s2 = plan->length * y[2], mirror = place ? -1.0 : 1.0;
    for (int i = 0; i < 2; ++i) {
        double flip = i == 0 ? mirror : 1.0; /* horizontal; and once more for odd derivatives */
        d[0][i] = flip * frame[0][i];
        d[1][i] = flip * mirror * frame[1][i] * s1;
        d[2][i] = flip * (frame[2][i] * s1 * s1 + frame[1][i] * s2);
    }
    *ds = s1;
    *length = arc;
}
