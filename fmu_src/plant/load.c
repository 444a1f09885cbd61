/* Motor load. The winding is one thermal mass that copper losses heat and time cools:
 *   T_th x' = (tau / tau_rated)^2 - x,  so that x = 1 is what the rated torque leads to in the long run. */
#include "load.h"

void load_add(const Drive *drive, const Axis *axis, double energy, Load *load)
{
    double begin = axis_torque(drive, axis, 0), middle = axis_torque(drive, axis, 1), end = axis_torque(drive, axis, 2);
    double square = (begin * begin + 4.0 * middle * middle + end * end) / 6.0;
    double losses = square / (drive->torque_rated * drive->torque_rated);
    load->thermal += drive->warming * (losses - load->thermal);
    load->time += DRIVE_PERIOD;
    load->square += square * DRIVE_PERIOD;
    if (energy > 0.0)
        load->work += energy;
    else
        load->regenerated -= energy;
}
