/* Calls `one` on many samples, again and again: what a call from C costs.
 *
 * The includer defines static void one(const double x[9], double f[3]): pose, velocity, acceleration to forces.
 */
enum { ROWS = 1024 };

static void (*volatile called)(const double *, double *) = one; /* a call that no compiler sees through */

/* Each call on the next of ROWS rows of 9, whatever the last one gave. */
void independent(long count, const double *rows, double *forces)
{
    void (*const function)(const double *, double *) = called;
    long i;
    for (i = 0; i < count; ++i)
        function(rows + 9 * (i % ROWS), forces + 3 * (i % ROWS));
}

/* Each call waits for the last one, as in a control loop. */
void dependent(long count, const double *rows, double *forces)
{
    void (*const function)(const double *, double *) = called;
    double x[9];
    long i;
    int k;
    for (k = 0; k < 9; ++k)
        x[k] = rows[k];
    for (i = 0; i < count; ++i) {
        function(x, forces);
        for (k = 0; k < 3; ++k) {
            x[k] = rows[k] + 1e-300 * forces[k];
            x[3 + k] = rows[3 + k] + 1e-300 * forces[k];
        }
    }
}
