/* Feed override: the rate at which the clock of a plan runs follows the input through a critically damped second-order filter,
 *   d2r/dt2 = w^2 (feed - r) - 2 w dr/dt,
 * so that acceleration is continuous and jerk bounded whatever the input does. Its impulse response w^2 t exp(-w t) is nowhere negative
 * and has the integral 1: an input in [0, 1] keeps the rate in [0, 1], and the robot never moves backwards. */
#ifndef FEED_H
#define FEED_H

typedef struct {
    double rate[3]; /* r, dr/dt, d2r/dt2 [1, 1/s, 1/s^2] */
} Feed;

void feed_start(Feed *feed, double input);

/* Has the rate come to the input for good? */
int feed_is_settled(const Feed *feed, double input);

/* One model step with the input held, solved exactly. Returned: how far the plan's clock moves on [s]. */
double feed_step(Feed *feed, double input);

#endif
