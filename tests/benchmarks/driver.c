/* Calls `one` on many samples, again and again: what a call from C costs.
 *
 * The includer defines static void one(const REAL x[9], REAL f[3]): pose, velocity, acceleration to forces. With REAL defined
 * as float they are floats.
 */
#ifndef REAL
#define REAL double
#endif

enum { ROWS = 1024 };

static void (*volatile called)(const REAL *, REAL *) = one; /* a call that no compiler sees through */

/* Each call on the next of ROWS rows of 9, whatever the last one gave. */
void independent(long count, const REAL *rows, REAL *forces)
{
    void (*const function)(const REAL *, REAL *) = called;
    long i;
    for (i = 0; i < count; ++i)
        function(rows + 9 * (i % ROWS), forces + 3 * (i % ROWS));
}

/* Each call waits for the last one, as in a control loop. */
void dependent(long count, const REAL *rows, REAL *forces)
{
    void (*const function)(const REAL *, REAL *) = called;
    REAL x[9];
    long i;
    int k;
    for (k = 0; k < 9; ++k)
        x[k] = rows[k];
    for (i = 0; i < count; ++i) {
        function(x, forces);
        for (k = 0; k < 3; ++k) {
            x[k] = rows[k] + (REAL)1e-30 * forces[k];
            x[3 + k] = rows[3 + k] + (REAL)1e-30 * forces[k];
        }
    }
}
