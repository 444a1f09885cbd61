/* FMU states: taking, restoring and serializing the snapshot of an instance. */
#include "snapshot.h"

#include <stdlib.h>
#include <string.h>

/* "dphS" on a little-endian machine; read by a machine of the other kind it is another number. */
static const uint32_t SNAPSHOT_MAGIC = 0x53687064u;
static const uint32_t SNAPSHOT_VERSION = 1;

/* FNV-1a, 64 bits (Fowler, Noll, Vo). */
static uint64_t hash(const void *bytes, size_t size)
{
    const unsigned char *const byte = bytes;
    uint64_t h = 0xcbf29ce484222325u;
    for (size_t k = 0; k < size; k++) {
        h = (h ^ byte[k]) * 0x100000001b3u;
    }
    return h;
}

static uint64_t build_hash(void)
{
    return hash(model_info.token, strlen(model_info.token));
}

/* Checksum of everything behind the member `checksum`. */
static uint64_t content_hash(const Snapshot *snapshot)
{
    const size_t begin = offsetof(Snapshot, checksum) + sizeof snapshot->checksum;
    return hash((const unsigned char *)snapshot + begin, snapshot_size() - begin);
}

size_t snapshot_size(void)
{
    return sizeof(Snapshot) + model_info.size;
}

void snapshot_start(Snapshot *snapshot)
{
    memset(snapshot, 0, snapshot_size());
    snapshot->magic = SNAPSHOT_MAGIC;
    snapshot->version = SNAPSHOT_VERSION;
    snapshot->size = snapshot_size();
    snapshot->build = build_hash();
    snapshot->state = INSTANTIATED;
    for (size_t k = 0; k < model_info.n_variables; k++) {
        const Variable *const variable = &model_info.variables[k];
        void *const value = (char *)snapshot->model + variable->offset;
        if (variable->type == TYPE_FLOAT64) {
            *(double *)value = variable->start;
        } else {
            *(int32_t *)value = (int32_t)variable->start;
        }
    }
}

/* Is this a snapshot of this build of this model? */
static Status check(const Instance *instance, const Snapshot *snapshot)
{
    if (snapshot->magic != SNAPSHOT_MAGIC || snapshot->version != SNAPSHOT_VERSION) {
        return instance_log(instance, STATUS_ERROR, "expected an FMU state of format %08lx version %lu but was %08lx version %lu",
                            (unsigned long)SNAPSHOT_MAGIC, (unsigned long)SNAPSHOT_VERSION, (unsigned long)snapshot->magic,
                            (unsigned long)snapshot->version);
    }
    if (snapshot->size != snapshot_size() || snapshot->build != build_hash()) {
        return instance_log(instance, STATUS_ERROR, "expected an FMU state of %s %s but was of another model or build",
                            model_info.identifier, model_info.token);
    }
    return STATUS_OK;
}

/* The same, of a pointer the importer hands in. */
static Status check_pointer(const Instance *instance, const void *state)
{
    const Status status = instance_expect_pointer(instance, state, "FMUState");
    return status == STATUS_OK ? check(instance, state) : status;
}

/* Memory for a copy of a snapshot, or NULL, having logged it. */
static Snapshot *new_snapshot(const Instance *instance)
{
    Snapshot *const snapshot = calloc(1, snapshot_size());
    if (!snapshot) {
        instance_log(instance, STATUS_ERROR, "expected memory for an FMU state but was out of it");
    }
    return snapshot;
}

Status instance_get_state(const Instance *instance, void **state)
{
    Status status = instance_expect_pointer(instance, state, "FMUState");
    if (status != STATUS_OK) {
        return status;
    }
    if (!*state) {
        *state = new_snapshot(instance);
        if (!*state) {
            return STATUS_ERROR;
        }
    } else if ((status = check(instance, *state)) != STATUS_OK) { /* an earlier copy, to be overwritten */
        return status;
    }
    memcpy(*state, instance->now, snapshot_size());
    return STATUS_OK;
}

Status instance_set_state(Instance *instance, const void *state)
{
    const Status status = check_pointer(instance, state);
    if (status == STATUS_OK) {
        memcpy(instance->now, state, snapshot_size());
    }
    return status;
}

Status instance_free_state(const Instance *instance, void **state)
{
    if (!state || !*state) {
        return STATUS_OK; /* both standards: ignored */
    }
    const Status status = check(instance, *state);
    if (status == STATUS_OK) {
        free(*state);
        *state = NULL;
    }
    return status;
}

Status instance_state_size(const Instance *instance, const void *state, size_t *size)
{
    Status status = check_pointer(instance, state);
    if (status == STATUS_OK) {
        status = instance_expect_pointer(instance, size, "size");
    }
    if (status == STATUS_OK) {
        *size = snapshot_size();
    }
    return status;
}

static Status check_bytes(const Instance *instance, const void *bytes, size_t size)
{
    if (size != snapshot_size()) {
        return instance_log(instance, STATUS_ERROR, "expected a serialized state of %lu bytes but was %lu",
                            (unsigned long)snapshot_size(), (unsigned long)size);
    }
    return instance_expect_pointer(instance, bytes, "serializedState");
}

Status instance_serialize(const Instance *instance, const void *state, void *bytes, size_t size)
{
    Status status = check_pointer(instance, state);
    if (status == STATUS_OK) {
        status = check_bytes(instance, bytes, size);
    }
    if (status == STATUS_OK) {
        const uint64_t checksum = content_hash(state);
        memcpy(bytes, state, size);
        memcpy((char *)bytes + offsetof(Snapshot, checksum), &checksum, sizeof checksum);
    }
    return status;
}

Status instance_deserialize(const Instance *instance, const void *bytes, size_t size, void **state)
{
    Status status = check_bytes(instance, bytes, size);
    if (status == STATUS_OK) {
        status = instance_expect_pointer(instance, state, "FMUState");
    }
    if (status != STATUS_OK) {
        return status;
    }
    Snapshot *const snapshot = new_snapshot(instance);
    if (!snapshot) {
        return STATUS_ERROR;
    }
    memcpy(snapshot, bytes, size);
    status = check(instance, snapshot);
    if (status == STATUS_OK && snapshot->checksum != content_hash(snapshot)) {
        status = instance_log(instance, STATUS_ERROR, "expected a serialized state as it was written but was a damaged one");
    }
    if (status != STATUS_OK) {
        free(snapshot);
        return status;
    }
    *state = snapshot;
    return STATUS_OK;
}
