/* Counts what Python allocates in one thread, by standing in front of its allocators. The interface is that of CPython's pymem.h. */
#include <stddef.h>

typedef struct {
    void *context;
    void *(*malloc)(void *, size_t);
    void *(*calloc)(void *, size_t, size_t);
    void *(*realloc)(void *, void *, size_t);
    void (*free)(void *, void *);
} Allocator;

extern void PyMem_GetAllocator(int domain, Allocator *allocator);
extern void PyMem_SetAllocator(int domain, Allocator *allocator);

enum { DOMAINS = 3 }; /* raw, mem, obj */

static Allocator original[DOMAINS];
static __thread int counting;
static __thread long long count;

static void *count_malloc(void *context, size_t size)
{
    Allocator *next = context;
    count += counting;
    return next->malloc(next->context, size);
}

static void *count_calloc(void *context, size_t number, size_t size)
{
    Allocator *next = context;
    count += counting;
    return next->calloc(next->context, number, size);
}

static void *count_realloc(void *context, void *block, size_t size)
{
    Allocator *next = context;
    count += counting;
    return next->realloc(next->context, block, size);
}

static void pass_free(void *context, void *block)
{
    Allocator *next = context;
    next->free(next->context, block);
}

/* Called once, with the interpreter held. */
void install(void)
{
    for (int domain = 0; domain < DOMAINS; domain++) {
        PyMem_GetAllocator(domain, &original[domain]);
        Allocator counted = {&original[domain], count_malloc, count_calloc, count_realloc, pass_free};
        PyMem_SetAllocator(domain, &counted);
    }
}

void remove_counter(void)
{
    for (int domain = 0; domain < DOMAINS; domain++)
        PyMem_SetAllocator(domain, &original[domain]);
}

/* Start or stop counting in this thread. */
void set_counting(int on)
{
    counting = on;
}

/* Allocations counted in this thread so far. */
long long counted(void)
{
    return count;
}
