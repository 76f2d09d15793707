/* Times every call of one function: how long calls take at all, and how a loop with a period keeps it.
 *
 * The includer defines static int call(long i), which computes sample i and returns a status.
 *
 * program spread COUNT             nanoseconds of COUNT calls: lines of a lower end and a number
 * program loop RATE SECONDS FIFO   at RATE [Hz]: lines "wake ..." and "work ...", likewise
 */
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>

enum { LINEAR = 4096, SHARES = 64, BINS = LINEAR + (SHARES * 40) };

static uint32_t wake[BINS], work[BINS];
static volatile int last;

static int64_t now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return ((int64_t)t.tv_sec * 1000000000) + t.tv_nsec;
}

/* Single nanoseconds up to LINEAR, then SHARES parts of each octave. */
static void enter(uint32_t *bins, int64_t time)
{
    int octave = 12;
    if (time < LINEAR) {
        ++bins[(time < 0) ? 0 : time];
        return;
    }
    while ((time >> (octave + 1)) != 0) {
        ++octave;
    }
    ++bins[LINEAR + ((octave - 12) * SHARES) + ((time >> (octave - 6)) & (SHARES - 1))];
}

static void print(const char *name, const uint32_t *bins)
{
    int i;
    for (i = 0; i < BINS; ++i) {
        if (bins[i] != 0) {
            const int octave = (i - LINEAR) / SHARES, share = (i - LINEAR) % SHARES;
            const long long lower = (i < LINEAR) ? i : (((long long)SHARES + share) << (octave + 6));
            printf("%s %lld %u\n", name, lower, (unsigned)bins[i]);
        }
    }
}

static int spread(long count)
{
    long i, failed = 0;
    for (i = 0; i < count; ++i) {
        const int64_t start = now();
        const int status = call(i);
        enter(work, now() - start);
        failed += (status != 0);
    }
    printf("failed 0 %ld\n", failed);
    print("work", work);
    for (i = 0, memset(work, 0, sizeof work); i < 1000000; ++i) {
        const int64_t start = now();
        enter(work, now() - start);
    }
    print("clock", work);
    return 0;
}

static int loop(long rate, double seconds, int fifo)
{
    const int64_t period = 1000000000 / rate;
    const long count = (long)(seconds * (double)rate);
    struct sched_param priority;
    int64_t next;
    long i;
    memset(&priority, 0, sizeof priority);
    priority.sched_priority = 80;
    if ((fifo != 0) && (sched_setscheduler(0, SCHED_FIFO, &priority) != 0)) {
        perror("SCHED_FIFO");
        return 2;
    }
    (void)mlockall(MCL_CURRENT | MCL_FUTURE);
    next = now() + period;
    for (i = 0; i < count; ++i, next += period) {
        struct timespec at;
        int64_t start;
        at.tv_sec = (time_t)(next / 1000000000);
        at.tv_nsec = (long)(next % 1000000000);
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL) != 0) {
        }
        start = now();
        enter(wake, start - next);
        last = call(i);
        enter(work, now() - start);
    }
    print("wake", wake);
    print("work", work);
    return 0;
}

int main(int argc, char **argv)
{
    if ((argc == 3) && (strcmp(argv[1], "spread") == 0)) {
        return spread(atol(argv[2]));
    }
    if ((argc == 5) && (strcmp(argv[1], "loop") == 0)) {
        return loop(atol(argv[2]), atof(argv[3]), atoi(argv[4]));
    }
    return 1;
}
