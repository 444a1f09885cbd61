/* Can the robot follow a path: within reach, joint ranges, and away from singularities everywhere, not only where one looks.
 *
 * Each pose tells how far the platform may go, in whatever direction, before anything can be amiss; the check goes that far along the path
 * and looks again. With sigma_i = s_i . E'_i / (La l), the first kind of dexterity (0 where upper arm and forearm are aligned, which is
 * also where the reach ends), a path of length ds moves
 *   the joint       theta_i by at most ds / (La sigma_i):  theta' = s . p' / (s . E'), |s| = l, |p'| = 1;
 *   the forearm     s_i / l by at most ds / (l sigma_i):   s' = p' - E' theta' is p' projected along E' on the plane across s, and such
 *                   a projection is longer by at most |s| |E'| / |s . E'| = 1 / sigma;
 *   the second kind det [s_1, s_2, s_3] / l^3 by at most the sum of these, the other two columns being of unit length;
 *   sigma_i^2       by at most 2 c ds / l, c = 1 + sqrt(1 + (l / La)^2), from sigma = across / l and across' = n . p' - along theta':
 *                   sigma |sigma'| <= (sigma + |along| / La) / l, where |along| <= La + l sqrt(1 - sigma^2) (delta_arms.h),
 *                   and sigma + (l / La) sqrt(1 - sigma^2) is at most sqrt(1 + (l / La)^2).
 * From sigma on, then, sigma_i stays above sigma - drop for ds = drop (2 sigma - drop) l / (2 c), and meanwhile theta_i changes by at most
 * int ds / (La sigma) = drop l / (c La), s_i / l by at most drop / c. All that is left to say is how great a drop each bound allows. */
#include <math.h>

#include "delta_arms.h"
#include "laws.h"
#include "path.h"

/* Least dexterity on a path; at the sources' default robot the paper's path keeps above 0.7. */
static const double least_dexterity = 0.1;

/* Steps are at least this share of the shorter link, so that a path along a bound comes to an end: less than 0.04 mm for the default robot,
 * within which a bound can be exceeded unseen by no more than half such a step is worth: at the least dexterity 0.03 degrees. */
static const double least_step = 1e-4;

/* And at least this share of a path. */
static const double least_share = 1e-6;

/* Judge one pose. Returned besides: how far the platform may go from there [m]. */
static dph_verdict pose_check(const dph_robot *robot, const double point[3], dph_phase phase, double *clearance)
{
    dph_pose pose;
    dph_verdict verdict = dph_pose_at(robot, point, &pose);
    verdict.phase = phase;
    if (verdict.status != DPH_STATUS_OK)
        return verdict;

    double upper = robot->upper_arm_length, forearm = robot->forearm_length, theta[3], margin[3];
    dph_pose_angles(&pose, theta);
    for (int i = 0; i < 3; ++i) {
        double below = theta[i] - robot->joint_position_min, above = robot->joint_position_max - theta[i];
        if (below < 0.0 || above < 0.0)
            return dph_refuse(DPH_STATUS_JOINT_RANGE, phase, i + 1, theta[i],
                              below < 0.0 ? robot->joint_position_min : robot->joint_position_max);
        margin[i] = fmin(below, above);
    }
    double aligned[3], coplanar;
    dph_pose_dexterities(robot, &pose, aligned, &coplanar);
    double dexterity = fmin(fmin(aligned[0], aligned[1]), fmin(aligned[2], coplanar));
    if (!(dexterity >= least_dexterity))
        return dph_refuse(DPH_STATUS_SINGULAR, phase, 0, least_dexterity, dexterity);

    double ratio = forearm / upper, c = 1.0 + sqrt(1.0 + ratio * ratio), least = HUGE_VAL;
    for (int i = 0; i < 3; ++i) {
        double drop = fmin(fmin(aligned[i] - least_dexterity, c * margin[i] / ratio), c * (coplanar - least_dexterity) / 3.0);
        least = fmin(least, drop * (2.0 * aligned[i] - drop));
    }
    *clearance = least * forearm / (2.0 * c);
    return verdict;
}

/* A way through the workspace: a parameter runs from boundary to boundary of the pieces, and the platform moves by at most `speed` [m]
 * where it changes by one. */
typedef struct Way {
    int pieces;
    const double *boundary;
    const dph_phase *phase;
    double speed;
    void (*at)(const dph_plan *plan, int piece, double parameter, dph_planar *motion);
} Way;

/* By arc length. */
static void on_path(const dph_plan *plan, int segment, double arc_length, dph_planar *motion)
{
    motion->side = segment >= 3;
    dph_path_at(plan, segment, motion->side ? plan->length - arc_length : arc_length, motion->d);
}

static dph_verdict point_check(const dph_plan *plan, const Way *way, int piece, double parameter, double *clearance)
{
    dph_planar motion;
    double point[3];
    way->at(plan, piece, parameter, &motion);
    const double *origin = motion.side == 0 ? plan->task.pick : plan->task.place;
    for (int k = 0; k < 2; ++k)
        point[k] = origin[k] + motion.d[0][0] * plan->direction[k];
    point[2] = origin[2] + motion.d[0][1];
    return pose_check(&plan->robot, point, way->phase[piece], clearance);
}

/* The first pose that is refused lies just beyond a bound: how far beyond it does the rest of its piece go? */
static dph_verdict worst_from(const dph_plan *plan, const Way *way, int piece, double parameter, dph_verdict worst)
{
    enum { LOOKS = 64 };
    double rest = way->boundary[piece + 1] - parameter, clearance;
    for (int i = 1; i <= LOOKS; ++i) {
        dph_verdict verdict = point_check(plan, way, piece, parameter + rest * i / LOOKS, &clearance);
        if (verdict.status == worst.status && verdict.joint == worst.joint &&
            fabs(verdict.required - verdict.available) > fabs(worst.required - worst.available))
            worst = verdict;
    }
    return worst;
}

dph_verdict dph_path_check(const dph_plan *plan, dph_cursor *cursor, int *units)
{
    Way way = {SEGMENTS, plan->segment_arc, dph_segment_phase, 1.0, on_path};
    if (plan->task.law == DPH_LAW_COMPARISON) /* by time: it has no path before its motion */
        way = (Way){plan->pieces, plan->boundary, plan->phase, hypot(plan->task.corner_entry_speed, plan->task.traverse_speed),
                    dph_superposition_motion};

    double end = way.boundary[way.pieces], clearance;
    double least = fmax(least_step * fmin(plan->robot.upper_arm_length, plan->robot.forearm_length) / way.speed, least_share * end);
    for (; cursor->at < end; --*units) {
        if (*units <= 0)
            return dph_unfinished();
        while (cursor->at >= way.boundary[cursor->piece + 1])
            ++cursor->piece;
        dph_verdict verdict = point_check(plan, &way, cursor->piece, cursor->at, &clearance);
        if (verdict.status != DPH_STATUS_OK)
            return worst_from(plan, &way, cursor->piece, cursor->at, verdict);
        cursor->at += fmax(clearance / way.speed, least);
    }
    /* The end itself, in the last piece that this path has. */
    int last = way.pieces - 1;
    while (last > 0 && !(way.boundary[last] < end))
        --last;
    dph_verdict verdict = point_check(plan, &way, last, end, &clearance);
    return verdict.status == DPH_STATUS_OK ? dph_accept() : verdict;
}
