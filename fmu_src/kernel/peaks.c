/* Peaks of a plan over continuous time. */
#include <limits.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "corner_law.h"
#include "laws.h"

/* A corner is scanned by its curve parameter where V_N / V_B is beyond these: evenly spaced times would nearly all lie where it is slow,
 * its ends or its middle, and pass over the rest of its way. */
static const double least_ratio = 1.0 / 20.0, greatest_ratio = 4.0;

static double norm(const double v[3])
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static void channels_at(const dph_plan *plan, int piece, double time, double value[DPH_CHANNELS])
{
    dph_setpoint s;
    dph_plan_sample_piece(plan, piece, time, &s);
    for (int i = 0; i < 3; ++i) {
        value[i] = fabs(s.joint_velocity[i]);
        value[3 + i] = fabs(s.joint_acceleration[i]);
        value[6 + i] = fabs(s.joint_jerk[i]);
        value[9 + i] = fabs(s.joint_torque[i]);
    }
    value[12] = norm(s.tcp_velocity);
    value[13] = norm(s.tcp_acceleration);
}

/* Golden-section search for the maximum of one channel in [low, high]. A maximum is flat: 40 steps leave 4e-9 of the interval, and so an
 * error of the value far below its rounding. */
static double refine(const dph_plan *plan, int piece, int channel, double low, double high)
{
    static const double golden = 0.61803398874989484820;
    double value[DPH_CHANNELS], best = 0.0;
    double left = high - golden * (high - low), right = low + golden * (high - low);
    channels_at(plan, piece, left, value);
    double at_left = value[channel];
    channels_at(plan, piece, right, value);
    double at_right = value[channel];
    for (int i = 0; i < 40; ++i) {
        best = fmax(best, fmax(at_left, at_right));
        if (at_left > at_right) {
            high = right;
            right = left;
            at_right = at_left;
            left = high - golden * (high - low);
            channels_at(plan, piece, left, value);
            at_left = value[channel];
        } else {
            low = left;
            left = right;
            at_left = at_right;
            right = low + golden * (high - low);
            channels_at(plan, piece, right, value);
            at_right = value[channel];
        }
    }
    return fmax(best, fmax(at_left, at_right));
}

/* Work of a scan and of refine() [units]: half a unit per setpoint. */
enum { SCAN_UNITS = DPH_SCAN / 2, REFINE_UNITS = 21 };

/* The motion law of a piece that is a corner of very unequal speeds, or NULL. */
static const dph_corner_law *unequal_corner(const dph_plan *plan, int piece)
{
    if (plan->task.law != DPH_LAW_PAPER && plan->task.law != DPH_LAW_PAPER_LIMITED)
        return NULL;
    const dph_corner_law *law = piece == 1 ? &plan->side[0].corner : piece == 4 ? &plan->side[1].corner : NULL;
    if (!law || (law->mid_speed >= least_ratio * law->entry_speed && law->mid_speed <= greatest_ratio * law->entry_speed))
        return NULL;
    return law;
}

/* The times of a scan [s]; 0 where the piece is empty. */
static int scan_times(const dph_plan *plan, int piece, double time[DPH_SCAN + 1])
{
    double factor = plan->speed_factor, begin = plan->boundary[piece] / factor, end = plan->boundary[piece + 1] / factor;
    double step = (end - begin) / DPH_SCAN;
    const dph_corner_law *law = unequal_corner(plan, piece);
    for (int i = 0; i <= DPH_SCAN; ++i) {
        time[i] = begin + step * i;
        if (law && piece == 1)
            time[i] = begin + dph_corner_law_time(law, (double)i / DPH_SCAN) / factor;
        else if (law) /* the place side runs backwards */
            time[i] = end - dph_corner_law_time(law, (double)(DPH_SCAN - i) / DPH_SCAN) / factor;
    }
    return step > 0.0;
}

static void scan(const dph_plan *plan, dph_peak_search *s, const double time[DPH_SCAN + 1])
{
    for (int i = 0; i <= DPH_SCAN; ++i) {
        channels_at(plan, s->piece, time[i], s->scan[i]);
        for (int c = 0; c < DPH_CHANNELS; ++c)
            s->greatest[c] = fmax(s->greatest[c], s->scan[i][c]);
    }
}

void dph_peaks_begin(dph_peak_search *s)
{
    memset(s, 0, sizeof *s);
    s->channel = -1;
}

/* Peaks of each piece, its ends included: the greatest of a scan, and the maxima that may hide around it. A maximum worth refining lies
 * beside a scanned value that is not below its neighbours and within a tenth of the greatest. */
int dph_peaks_continue(const dph_plan *plan, dph_peak_search *s, int *units)
{
    for (; s->piece < plan->pieces; ++s->piece, s->channel = -1) {
        double time[DPH_SCAN + 1];
        if (!scan_times(plan, s->piece, time))
            continue;
        if (s->channel < 0) {
            if (*units <= 0)
                return 0;
            *units -= SCAN_UNITS;
            scan(plan, s, time);
            memcpy(s->peak, s->greatest, sizeof s->peak);
            s->channel = s->sample = 0;
        }
        for (; s->channel < DPH_CHANNELS; ++s->channel, s->sample = 0) {
            int c = s->channel;
            for (; s->sample <= DPH_SCAN; ++s->sample) {
                int i = s->sample, before = i > 0 ? i - 1 : 0, after = i < DPH_SCAN ? i + 1 : DPH_SCAN;
                double here = s->scan[i][c];
                if (!(here >= s->scan[before][c] && here >= s->scan[after][c] && here > 0.9 * s->greatest[c]))
                    continue;
                if (*units <= 0)
                    return 0;
                *units -= REFINE_UNITS;
                s->peak[c] = fmax(s->peak[c], refine(plan, s->piece, c, time[before], time[after]));
            }
        }
        memcpy(s->greatest, s->peak, sizeof s->peak);
    }
    return 1;
}

void dph_peaks_of(const dph_peak_search *search, dph_peaks *peaks)
{
    const double *peak = search->peak;
    for (int i = 0; i < 3; ++i) {
        peaks->joint_velocity[i] = peak[i];
        peaks->joint_acceleration[i] = peak[3 + i];
        peaks->joint_jerk[i] = peak[6 + i];
        peaks->joint_torque[i] = peak[9 + i];
    }
    peaks->tcp_speed = peak[12];
    peaks->tcp_acceleration = peak[13];
}

void dph_plan_peaks(const dph_plan *plan, dph_peaks *peaks)
{
    dph_peak_search search;
    int units;
    dph_peaks_begin(&search);
    do
        units = INT_MAX;
    while (!dph_peaks_continue(plan, &search, &units));
    dph_peaks_of(&search, peaks);
}
