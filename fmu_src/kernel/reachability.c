/* The time-optimal law where only velocity and acceleration are limited: reachability analysis.
 * H. Pham and Q.-C. Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis", IEEE Transactions on
 * Robotics 34(3), 2018: a backward pass finds the greatest value of each unknown from which rest can be reached, a forward pass takes the
 * greatest one that can be reached.
 *
 * Here b is a quadratic spline, so that acceleration is continuous. Its control polygon has a vertex in the middle of every interval and
 * one at each end, and so a leg at every knot, which the spline touches there. An acceleration, linear in the two vertices of a leg, is
 * constrained at the knot, where it is exact; in between, where b and b' are means of those of two legs, an error of second order is left.
 * What it amounts to is measured, the constraints are tightened by it, and the passes are run again. */
#include <math.h>
#include <string.h>

#include "delta_arms.h"
#include "time_optimal.h"

/* Intervals of a first, coarse b, in each segment of a side; of the final one about so many, at least so many in each segment. */
enum { SPLINE_INTERVALS = 54 };
static const int coarse_intervals[3] = {5, 9, 5};
static const int spline_intervals[3] = {3, 13, 3};

/* First vertex over second one and second over third, and the same from the other end: at rest q' = q'' = 0, and nothing bounds them.
 * Constant acceleration from rest is b ~ 1/x. */
static const double rise = 2.2;

/* Parts of an interval on which the limits are verified; repairs at most, and a stretch that is worth none. */
enum { SPLINE_PARTS = 6, SPLINE_REPAIRS = 3 };
static const double enough = 1.0005;

/* What the verification does not see, as a ratio of velocities. Of acceleration, its square, 1.4e-3 was the most in 400 random tasks under
 * random limits, and 2e-4 in 1000 under those of the paper; 1e-3 beyond a limit is what may be left. */
static const double unseen = 1.0003;

/* ---- Geometry --------------------------------------------------------------------------------------------------------------------- */

/* What has been seen of the path: can the robot follow it? */
typedef struct Survey {
    double middle[2], cosine; /* joint range: direction of its middle, cosine of its half */
    int reached, in_range;
    double least_dexterity, widest, before; /* greatest distance of two points, arc length of the last one [m] */
} Survey;

/* All points lie this far inside the joint range [rad]: more than a joint can do beyond two points 0.1 m apart, 0.1^2 / 8 times its second
 * derivative by arc length, which is below 8 rad/m^2 at dexterities of 0.3 and more. */
static const double margin = 0.01;

static void survey_begin(const dph_robot *robot, Survey *survey)
{
    double middle = 0.5 * (robot->joint_position_min + robot->joint_position_max), half = robot->joint_position_max - middle - margin;
    Survey begin = {{cos(middle), sin(middle)}, half > 0.0 ? cos(half) : 2.0, 1, 1, HUGE_VAL, 0.0, 0.0};
    *survey = begin;
}

/* No doubt about the path? Distances as in dph_path_check: with the dexterity that is left twice as great, twice as far and twice as slow. */
static int is_clear_of(const Survey *survey)
{
    double d = survey->least_dexterity;
    return survey->reached && survey->in_range && survey->widest <= 0.1 && survey->widest <= 0.01 * (d * d) / (0.1 * 0.1);
}

static void point_at(const dph_plan *plan, int segment, double x, dph_corner_walk *walk, Survey *survey, dph_reach_point *point)
{
    double planar[3][2], d[3][3], arc;
    dph_path_walk(plan, segment, x, walk, planar, &point->ds, &arc);
    const double *origin = segment >= 3 ? plan->task.place : plan->task.pick;
    for (int order = 0; order < 3; ++order) {
        d[order][0] = planar[order][0] * plan->direction[0];
        d[order][1] = planar[order][0] * plan->direction[1];
        d[order][2] = planar[order][1];
    }
    for (int i = 0; i < 3; ++i)
        d[0][i] += origin[i];
    dph_rates rates;
    if (!dph_rates_at(&plan->robot, d[0], d[1], d[2], &rates)) {
        survey->reached = 0;
        return;
    }
    memcpy(point->q, rates.q, sizeof point->q);
    for (int i = 0; i < 3; ++i)
        survey->in_range &= rates.direction[i][0] * survey->middle[0] + rates.direction[i][1] * survey->middle[1] > survey->cosine;
    survey->least_dexterity = rates.dexterity < survey->least_dexterity ? rates.dexterity : survey->least_dexterity;
    arc = segment >= 3 ? plan->length - arc : arc;
    survey->widest = arc - survey->before > survey->widest ? arc - survey->before : survey->widest;
    survey->before = arc;
}

/* In the middle of an interval, from its ends: q' by the cubic with its values and slopes, q'' its derivative. */
static void middle_between(const dph_reach_point *a, const dph_reach_point *b, double width, dph_reach_point *middle)
{
    double per_width = 1.5 / width;
    for (int i = 0; i < 3; ++i) {
        middle->q[0][i] = 0.5 * (a->q[0][i] + b->q[0][i]) + 0.125 * width * (a->q[1][i] - b->q[1][i]);
        middle->q[1][i] = per_width * (b->q[0][i] - a->q[0][i]) - 0.25 * (a->q[1][i] + b->q[1][i]);
    }
}

static int is_corner(int segment)
{
    return segment == 1 || segment == 4;
}

/* Points at the knots, and in the middles of the intervals. Where they need not be exact, and on straights, where they are to some 1e-6 of
 * the limits, these follow from the knots. */
static void lay_points(const dph_plan *plan, dph_workspace *w, int exact, Survey *survey)
{
    dph_corner_walk walk;
    memset(&walk, 0, sizeof walk);
    survey->before = 0.0;
    for (int k = 0; k < w->intervals; ++k) {
        int segment = w->segment[k];
        if (k > 0 && w->segment[k - 1] != segment)
            memset(&walk, 0, sizeof walk);
        point_at(plan, segment, w->inner[k], &walk, survey, &w->reach[k][0]);
        if (exact && is_corner(segment))
            point_at(plan, segment, 0.5 * (w->knot[k] + w->knot[k + 1]), &walk, survey, &w->reach[k][1]);
    }
    int n = w->intervals;
    point_at(plan, w->segment[n - 1], 1.0, &walk, survey, &w->reach[n][0]);
    for (int k = 0; k < n; ++k) {
        double width = w->knot[k + 1] - w->knot[k];
        if (!exact || !is_corner(w->segment[k])) {
            double y[4];
            dph_parameter_at(0.5 * (w->knot[k] + w->knot[k + 1]), y);
            w->reach[k][1].ds = plan->length * y[1];
            middle_between(&w->reach[k][0], &w->reach[k + 1][0], width, &w->reach[k][1]);
        }
    }
}

/* ---- The two passes --------------------------------------------------------------------------------------------------------------- */

static double inverse_cap(const dph_bounds *bounds, const dph_reach_point *point)
{
    double tcp = point->ds * bounds->tcp_speed, cap = tcp * tcp > bounds->least_inverse_cap ? tcp * tcp : bounds->least_inverse_cap;
    for (int i = 0; i < 3; ++i) {
        double v = point->q[0][i] * bounds->velocity[i];
        cap = v * v > cap ? v * v : cap;
    }
    return cap;
}

/* What the points say to the passes: rows at the knots, in the middles greatest b by velocity, and where b' does not count, by acceleration. */
static void lay_rows(dph_workspace *w)
{
    for (int k = 0; k < w->intervals; ++k) {
        const dph_reach_point *here = &w->reach[k][0], *middle = &w->reach[k][1];
        w->cap[k] = 1.0 / inverse_cap(&w->bounds, middle);
        for (int i = 0; i < 3; ++i) {
            double inverse = w->bounds.acceleration[i];
            w->row[k][0][i] = inverse * here->q[1][i];
            w->row[k][1][i] = inverse * 0.5 * here->q[0][i];
            w->bend[k][i] = inverse * fabs(middle->q[1][i]);
        }
    }
}

static inline double least_of(double a, double b)
{
    return a < b ? a : b;
}

/* A leg's rows |from u + to v| <= 1 in its two vertices, to >= 0. */
typedef struct Leg {
    double from[3], to[3];
} Leg;

/* Where both coefficients have the same sign, a joint bends more than it moves, and a greater u makes v smaller: the passes, which take the
 * greatest, would go up and down from vertex to vertex. Such a row bounds the vertex that counts more in it, to where the other rows let
 * the other vertex be greatest. */
static void calm(const Leg *leg, double v[2])
{
    for (int j = 0; j < 3; ++j) {
        double u = leg->from[j], t = leg->to[j];
        if (!(u > 0.0))
            continue;
        int second = t >= u;
        double most = second ? (1.0 - u * v[0]) / t : (1.0 - t * v[1]) / u;
        for (int i = 0; i < 3; ++i) {
            double d = u * leg->to[i] - leg->from[i] * t, at = second ? -leg->from[i] - u : leg->to[i] - t;
            if (leg->from[i] < 0.0 && at > most * d)
                most = at / d;
        }
        double both = 1.0 / (u + t);
        v[second] = least_of(v[second], most < 0.25 * both ? both : most);
    }
}

/* The greatest u for which there is a v in [0, v[1]]. */
static double backward(const Leg *leg, const double v[2])
{
    double most = v[0];
    for (int i = 0; i < 3; ++i) {
        double u = leg->from[i], room = u > 0.0 ? 1.0 : 1.0 + leg->to[i] * v[1];
        if (most * fabs(u) > room)
            most = room / fabs(u);
        for (int j = 0; j < i; ++j) {
            double d = fabs(u * leg->to[j] - leg->from[j] * leg->to[i]), sum = leg->to[i] + leg->to[j];
            if (most * d > sum)
                most = sum / d;
        }
    }
    return most;
}

/* The greatest v at u. */
static double forward(const Leg *leg, const double v[2])
{
    double most = v[1];
    for (int i = 0; i < 3; ++i) {
        double room = 1.0 - leg->from[i] * v[0];
        if (most * leg->to[i] > room)
            most = room / leg->to[i];
    }
    return most;
}

/* b and b' at the knots from the rows. */
static void solve(dph_workspace *w)
{
    int n = w->intervals; /* vertices 0 to n + 1 */
    double v[DPH_PIECES + 2], at[DPH_PIECES], span[DPH_PIECES];
    Leg leg[DPH_PIECES];
    memcpy(&v[1], w->cap, (size_t)n * sizeof *v);
    for (int k = 1; k < n; ++k) {
        span[k] = 0.5 * (w->knot[k + 1] - w->knot[k - 1]);
        at[k] = 0.5 * (w->knot[k] - w->knot[k - 1]) / span[k];
        double inverse = 1.0 / span[k];
        for (int i = 0; i < 3; ++i) {
            double c = w->row[k][0][i], slope = w->row[k][1][i] * inverse, u = c * (1.0 - at[k]) - slope, t = c * at[k] + slope;
            leg[k].from[i] = t < 0.0 ? -u : u;
            leg[k].to[i] = fabs(t);
            /* A joint that turns round in an interval has nothing there to brake with: b' does not count. */
            if (k < n - 1 && w->row[k][1][i] * w->row[k + 1][1][i] < 0.0 && v[k + 1] * w->bend[k][i] > 1.0)
                v[k + 1] = 1.0 / w->bend[k][i];
        }
    }
    for (int i = 0; i < 3; ++i) {
        v[2] = least_of(v[2], 1.0 / fabs(rise * leg[1].from[i] + leg[1].to[i]));
        v[n - 1] = least_of(v[n - 1], 1.0 / fabs(leg[n - 1].from[i] + rise * leg[n - 1].to[i]));
    }
    for (int k = 2; k < n - 1; ++k)
        calm(&leg[k], &v[k]);
    for (int k = n - 2; k > 1; --k)
        v[k] = backward(&leg[k], &v[k]);
    for (int k = 2; k < n - 1; ++k)
        v[k + 1] = forward(&leg[k], &v[k]);
    v[1] = rise * v[2];
    v[0] = rise * v[1];
    v[n] = rise * v[n - 1];
    v[n + 1] = rise * v[n];
    for (int k = 1; k < n; ++k) {
        w->slope[k] = (v[k + 1] - v[k]) / span[k];
        w->b[k] = v[k] + at[k] * (v[k + 1] - v[k]);
    }
    w->b[0] = v[0];
    w->b[n] = v[n + 1];
    w->slope[0] = 2.0 * (v[1] - v[0]) / (w->knot[1] - w->knot[0]);
    w->slope[n] = 2.0 * (v[n + 1] - v[n]) / (w->knot[n] - w->knot[n - 1]);
}

/* ---- Knots ------------------------------------------------------------------------------------------------------------------------ */

/* Knots where the coarse b bends: a quadratic spline's error in an interval of width h is h^2 b''/b. */
static void shares_of(const dph_workspace *w, dph_shares *shares)
{
    static const double evenly = 5.0, most = 1.5;
    int n = w->intervals;
    double density[DPH_PIECES + 1] = {0.0};
    for (int k = 1; k < n; ++k) {
        double before = w->knot[k] - w->knot[k - 1], after = w->knot[k + 1] - w->knot[k];
        double jump = (w->b[k + 1] - w->b[k]) / after - (w->b[k] - w->b[k - 1]) / before;
        density[k] = sqrt(fabs(jump) / (0.5 * (before + after) * w->b[k]));
    }
    density[0] = density[1];
    density[n] = density[n - 1];
    for (int pass = 0; pass < 2; ++pass) {
        double before = density[0];
        for (int k = 0; k < n; ++k) {
            double here = density[k];
            density[k] = 0.25 * (before + 2.0 * here + density[k + 1]);
            before = here;
        }
    }
    shares->intervals = n;
    shares->at[0] = shares->share[0] = 0.0;
    for (int k = 0; k < n; ++k) {
        double width = w->knot[k + 1] - w->knot[k], bend = 0.5 * width * (density[k] + density[k + 1]);
        shares->at[k + 1] = w->knot[k + 1];
        shares->share[k + 1] = shares->share[k] + least_of(bend, most) + evenly * width;
    }
    for (int k = 1; k < n; ++k)
        shares->share[k] /= shares->share[n];
    shares->share[n] = 1.0;
}

/* ---- Verification ----------------------------------------------------------------------------------------------------------------- */

/* What three points, with values and slopes, weigh in the quintic through them and in its slope; t from -1 to 1 between the outer two. */
static void weights_at(double t, double value[6], double slope[6])
{
    const double l[3] = {0.5 * t * (t - 1.0), 1.0 - t * t, 0.5 * t * (t + 1.0)}, l1[3] = {t - 0.5, -2.0 * t, t + 0.5};
    static const double c[3] = {3.0, 0.0, -3.0};
    for (int i = 0; i < 3; ++i) {
        double from = t - (i - 1), a = 1.0 + c[i] * from;
        value[i] = a * l[i] * l[i];
        slope[i] = c[i] * l[i] * l[i] + 2.0 * a * l[i] * l1[i];
        value[3 + i] = from * l[i] * l[i];
        slope[3 + i] = l[i] * l[i] + 2.0 * from * l[i] * l1[i];
    }
}

/* q' of joint j at both ends and in the middle of an interval, then its slopes by t. */
static void joint_of(const dph_workspace *w, int k, int j, double q[6])
{
    const dph_reach_point *point[3] = {&w->reach[k][0], &w->reach[k][1], &w->reach[k + 1][0]};
    double half = 0.5 * (w->knot[k + 1] - w->knot[k]);
    for (int i = 0; i < 3; ++i) {
        q[i] = point[i]->q[0][j];
        q[3 + i] = half * point[i]->q[1][j];
    }
}

static double weighted(const double weight[6], const double q[6])
{
    return weight[0] * q[0] + weight[1] * q[1] + weight[2] * q[2] + weight[3] * q[3] + weight[4] * q[4] + weight[5] * q[5];
}

static void lay_fine(const dph_plan *plan, dph_workspace *w)
{
    double value[SPLINE_PARTS + 1][6], slope[SPLINE_PARTS + 1][6];
    for (int i = 0; i <= SPLINE_PARTS; ++i)
        weights_at(2.0 * i / SPLINE_PARTS - 1.0, value[i], slope[i]);
    for (int k = 0; k < w->intervals; ++k) {
        double width = w->knot[k + 1] - w->knot[k], inverse = 2.0 / width, q[6];
        for (int j = 0; j < 3; ++j) {
            joint_of(w, k, j, q);
            for (int i = 0; i <= SPLINE_PARTS; ++i) {
                dph_path_point *point = &w->point[k][i];
                if (2 * i % SPLINE_PARTS == 0) { /* one of the three */
                    point->q[0][j] = q[2 * i / SPLINE_PARTS];
                    point->q[1][j] = inverse * q[3 + 2 * i / SPLINE_PARTS];
                } else {
                    point->q[0][j] = weighted(value[i], q);
                    point->q[1][j] = inverse * weighted(slope[i], q);
                }
            }
        }
        for (int i = 0; i <= SPLINE_PARTS && w->bounds.tcp_speed > 0.0; ++i) {
            double y[4];
            dph_parameter_at(w->knot[k] + width * i / SPLINE_PARTS, y);
            w->point[k][i].ds = plan->length * y[1];
        }
    }
}

/* Where between 0 and SPLINE_PARTS the parabola through a sample and its neighbours is greatest; -1 where that is not between the
 * neighbours. */
static double top_of(const double f[], int i)
{
    double sign = f[i] < 0.0 ? -1.0 : 1.0, gain = sign * (f[i + 1] - f[i - 1]), bend = sign * (2.0 * f[i] - f[i + 1] - f[i - 1]);
    return fabs(gain) <= 2.0 * bend && bend > 0.0 ? i + 0.5 * gain / bend : -1.0;
}

/* b and b' at u in an interval. */
static inline void spline_at(const dph_workspace *w, int k, double u, double v[2])
{
    double width = w->knot[k + 1] - w->knot[k], bend = w->slope[k + 1] - w->slope[k];
    v[0] = w->b[k] + width * u * (w->slope[k] + 0.5 * u * bend);
    v[1] = w->slope[k] + u * bend;
}

/* What joint j has over its limits at u in an interval: square of velocity, acceleration. */
static void ratios_at(const dph_workspace *w, int k, int j, double u, double ratio[2])
{
    double value[6], slope[6], q[6], v[2];
    weights_at(2.0 * u - 1.0, value, slope);
    joint_of(w, k, j, q);
    spline_at(w, k, u, v);
    double first = weighted(value, q), second = 2.0 / (w->knot[k + 1] - w->knot[k]) * weighted(slope, q);
    double speed = first * w->bounds.velocity[j];
    ratio[0] = speed * speed * v[0];
    ratio[1] = fabs(w->bounds.acceleration[j] * (second * v[0] + 0.5 * first * v[1]));
}

/* How far b goes beyond the limits in an interval, as in time_optimal.c: at the samples, and at the tops of parabolas through them. Returns 0
 * where b is not positive. */
static int excess_of(const dph_workspace *w, int k, double excess[2])
{
    static const double near = 0.97; /* no parabola through three samples below rises above 1 */
    const dph_bounds *bounds = &w->bounds;
    double value[SPLINE_PARTS + 1], half_slope[SPLINE_PARTS + 1]; /* of b */
    excess[0] = excess[1] = 0.0;
    for (int i = 0; i <= SPLINE_PARTS; ++i) {
        double v[2];
        spline_at(w, k, i * (1.0 / SPLINE_PARTS), v);
        if (!(v[0] > 0.0))
            return 0;
        value[i] = v[0];
        half_slope[i] = 0.5 * v[1];
        if (bounds->tcp_speed > 0.0) {
            double speed = w->point[k][i].ds * bounds->tcp_speed;
            excess[0] = speed * speed * v[0] > excess[0] ? speed * speed * v[0] : excess[0];
        }
    }
    for (int j = 0; j < 3; ++j) {
        double series[2][SPLINE_PARTS + 1], peak[2] = {0.0, 0.0};
        for (int i = 0; i <= SPLINE_PARTS; ++i) {
            const dph_path_point *point = &w->point[k][i];
            double first = point->q[0][j], speed = first * bounds->velocity[j];
            double square = speed * speed * value[i];
            double acceleration = bounds->acceleration[j] * (point->q[1][j] * value[i] + first * half_slope[i]);
            series[0][i] = square;
            series[1][i] = acceleration;
            peak[0] = square > peak[0] ? square : peak[0];
            peak[1] = fabs(acceleration) > peak[1] ? fabs(acceleration) : peak[1];
        }
        for (int what = 0; what < 2; ++what) {
            const double *f = series[what];
            double greatest = peak[what];
            for (int i = 1; i < SPLINE_PARTS && greatest > near; ++i) {
                double top = fabs(f[i]) > near ? top_of(f, i) : -1.0, ratio[2];
                if (top >= 0.0) {
                    ratios_at(w, k, j, top / SPLINE_PARTS, ratio);
                    greatest = ratio[what] > greatest ? ratio[what] : greatest;
                }
            }
            excess[what] = greatest > excess[what] ? greatest : excess[what];
        }
    }
    return 1;
}

/* The factor by which time has to be stretched to keep all limits, at least 1; 0 where b is not positive. Found besides: by how much each
 * interval goes beyond its limits. */
static double verify(dph_workspace *w)
{
    double stretch2 = 1.0;
    for (int k = 0; k < w->intervals; ++k) {
        double excess[2];
        if (!excess_of(w, k, excess))
            return 0.0;
        for (int i = 0; i < 2; ++i) {
            w->tighten[k][i] = excess[i] > 1.0 ? excess[i] : 1.0;
            stretch2 = excess[i] > stretch2 ? excess[i] : stretch2;
        }
    }
    return sqrt(stretch2);
}

/* Give the intervals that went beyond their limits tighter ones, also at both their knots. Where that has been done before and did not do,
 * the acceleration comes from what is between them: then also a lower vertex. */
static void tighten(dph_workspace *w, int again)
{
    for (int k = 0; k < w->intervals; ++k) {
        double own = w->tighten[k][1], before = w->tighten[k > 0 ? k - 1 : k][1], ratio = own > before ? own : before;
        double vertex = w->b[k] + 0.5 * (w->knot[k + 1] - w->knot[k]) * w->slope[k];
        w->cap[k] /= w->tighten[k][0];
        if (again && own > 1.0)
            w->cap[k] = least_of(w->cap[k], vertex / own);
        for (int i = 0; i < 3; ++i) {
            w->row[k][0][i] *= ratio;
            w->row[k][1][i] *= ratio;
            w->bend[k][i] *= own;
        }
    }
}

double dph_reachability(const dph_plan *plan, dph_workspace *w, int *is_clear)
{
    dph_shares shares = {1, {0.0, 1.0}, {0.0, 1.0}};
    Survey survey;
    survey_begin(&plan->robot, &survey);
    *is_clear = 0;
    for (int fine = 0; fine < 2; ++fine) {
        dph_knots_lay(plan, &shares, fine ? SPLINE_INTERVALS : 0, fine ? spline_intervals : coarse_intervals, w);
        lay_points(plan, w, fine, &survey);
        if (!survey.reached || w->intervals < 6)
            return 0.0;
        lay_rows(w);
        if (!fine) {
            solve(w);
            shares_of(w, &shares);
        }
    }
    *is_clear = is_clear_of(&survey);
    lay_fine(plan, w);
    for (int repair = 0;; ++repair) {
        solve(w);
        double stretch = verify(w);
        if (!(stretch > enough) || repair == SPLINE_REPAIRS)
            return stretch * unseen;
        tighten(w, repair > 0);
    }
}
