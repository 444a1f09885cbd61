/* Peaks of a plan over continuous time. */
#include <limits.h>
#include <math.h>
#include <string.h>

#include "laws.h"

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

static void scan(const dph_plan *plan, dph_peak_search *s, double begin, double step)
{
    for (int i = 0; i <= DPH_SCAN; ++i) {
        channels_at(plan, s->piece, begin + step * i, s->scan[i]);
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
        double begin = plan->boundary[s->piece] / plan->speed_factor;
        double step = (plan->boundary[s->piece + 1] / plan->speed_factor - begin) / DPH_SCAN;
        if (!(step > 0.0))
            continue;
        if (s->channel < 0) {
            if (*units <= 0)
                return 0;
            *units -= SCAN_UNITS;
            scan(plan, s, begin, step);
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
                s->peak[c] = fmax(s->peak[c], refine(plan, s->piece, c, begin + step * before, begin + step * after));
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
