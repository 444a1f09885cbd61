/* What the snapshot offers to the other files of the adapter only. */
#ifndef SNAPSHOT_H
#define SNAPSHOT_H

#include "instance.h"

/* Size of a snapshot with its model [bytes]. */
size_t snapshot_size(void);

/* Make it that of a new instance: start values, state INSTANTIATED. */
void snapshot_start(Snapshot *snapshot);

#endif
