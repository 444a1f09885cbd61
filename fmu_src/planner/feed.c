/* Feed override, see feed.h. */
#include "feed.h"

#include <math.h>

#include "fmi/model.h"

/* w [1/s]: a full stop takes about 0.15 s, and at 2.4 m/s adds at most 2.4 w / e = 44 m/s^2, half of what the paper's case has anyway. */
static const double bandwidth = 50.0;

/* What is left of a change when it counts as done: at 10 m/s a step of 5e-7 m/s^2 in acceleration. */
static const double settled = 1e-9;

void feed_start(Feed *feed, double input)
{
    feed->rate[0] = input;
    feed->rate[1] = feed->rate[2] = 0.0;
}

int feed_is_settled(const Feed *feed, double input)
{
    return feed->rate[0] == input && feed->rate[1] == 0.0;
}

double feed_step(Feed *feed, double input)
{
    /* With e = r - feed: e(t) = (e0 + c t) exp(-w t), c = e0' + w e0; the clock moves by the integral of feed + e. */
    const double w = bandwidth, h = MODEL_STEP;
    double e0 = feed->rate[0] - input, c = feed->rate[1] + w * e0, decay = exp(-w * h);
    double e = (e0 + c * h) * decay;
    double moved = input * h + (e0 * (1.0 - decay) + c * ((1.0 - decay) / w - h * decay)) / w;
    feed->rate[0] = input + e;
    feed->rate[1] = c * decay - w * e;
    feed->rate[2] = -w * (w * e + 2.0 * feed->rate[1]);
    if (fabs(e) < settled && fabs(feed->rate[1]) < w * settled)
        feed_start(feed, input);
    return moved;
}
