/* How the figures of designs change along a direction: `DesignLoop.tangent`. */

/* One design while it runs. A direction has nine numbers: r, R, L and how they change, then how y, z, theta do. */
typedef struct {
    const double *constants, *turning, *lengths, *offset;
    double *scratch;      /* lines of `DESIGN_LINE` */
    double *power, *rate; /* 3 × padded each, then two lines of steps */
    ptrdiff_t *turns;
    DesignTrack peak[3], low[3], high[3], speed[3], demand, angle;
    double square[3][DESIGN_LANES], product[3][DESIGN_LANES];
} Tangent;

enum { LENGTH_NUMBERS = 9, LINES_OF_TANGENT = 4 + 6 + 12 + 2 + 1 }; /* poses, forces, sliders, margins, zeros */

static void start_track(DesignTrack *track)
{
    for (int l = 0; l < DESIGN_LANES; ++l) {
        track->top[l] = -HUGE_VAL;
        track->when[l] = track->rate[l] = 0.0;
    }
}

static void start_tangent(Tangent *tangent)
{
    for (int leg = 0; leg < 3; ++leg) {
        start_track(&tangent->peak[leg]);
        start_track(&tangent->low[leg]);
        start_track(&tangent->high[leg]);
        start_track(&tangent->speed[leg]);
    }
    start_track(&tangent->demand);
    start_track(&tangent->angle);
    memset(tangent->square, 0, sizeof tangent->square);
    memset(tangent->product, 0, sizeof tangent->product);
}

/* The lane with the largest; of equal ones the one whose sample comes first. */
static int first_lane(const DesignTrack *track)
{
    int found = 0;
    for (int l = 1; l < DESIGN_LANES; ++l) {
        const double ahead = (track->when[l] + l) - (track->when[found] + found);
        if (track->top[l] > track->top[found] || (track->top[l] == track->top[found] && ahead < 0.0))
            found = l;
    }
    return found;
}

static double rate_of(const DesignTrack *track)
{
    return track->rate[first_lane(track)];
}

static ptrdiff_t sample_of(const DesignTrack *track)
{
    const int lane = first_lane(track);
    return (ptrdiff_t)track->when[lane] + lane;
}

/* How the least reach margin changes: that of one leg at one sample. */
static double reach_rate(const DesignLoop *self, const Tangent *tangent)
{
    const DesignMotion *motion = &self->motion;
    const double *n = tangent->lengths, r = n[0], R = n[1], dr = n[3], dR = n[4], dL = n[5], dy = n[6];
    const double low = motion->lowest + tangent->offset[0], high = motion->highest + tangent->offset[0];
    const double sideways = (R - r) + (high > -low ? high : -low);
    const ptrdiff_t at = sample_of(&tangent->demand);
    const double y = motion->rows[at] + tangent->offset[0];
    const double theta = motion->theta[at] + tangent->offset[2];
    const double across = R - r * cos(theta), distance = hypot(y, across);

    if (distance > sideways) {
        const double turning = dR - dr * cos(theta) + r * sin(theta) * n[8];
        return dL - (y * dy + across * turning) / distance;
    }
    const int of_a = high > -low || (high == -low && motion->highest_at <= motion->lowest_at);
    return dL - (dR - dr + (of_a ? dy : -dy));
}

/* How the least angle from the actuation singularity changes. */
static double angle_rate(const DesignLoop *self, const Tangent *tangent)
{
    const DesignMotion *motion = &self->motion;
    const double *n = tangent->lengths, r = n[0], R = n[1], L = n[2], dr = n[3], dR = n[4], dL = n[5];
    const ptrdiff_t at = sample_of(&tangent->angle);
    const double y = motion->rows[at] + tangent->offset[0], dy = n[6], dt = n[8];
    const double theta = motion->theta[at] + tangent->offset[2];
    const double sine = sin(theta), cosine = cos(theta), wc = R - r * cosine, u = sqrt((L - y) * (L + y));
    const double Sc = sqrt((u - wc) * (u + wc)), s = (cosine * Sc - sine * wc) / u;
    const double du = (L * dL - y * dy) / u, dw = dR - dr * cosine + r * sine * dt, dS = (u * du - wc * dw) / Sc;
    const double ds = (cosine * dS - sine * dw - (sine * Sc + cosine * wc) * dt - s * du) / u;

    return ds / sqrt((1.0 - s) * (1.0 + s));
}

static void slide_tangent(const DesignLoop *self, Tangent *tangent, ptrdiff_t start, ptrdiff_t now,
                          const double *const *in, double *const *force, double *const *slide)
{
    const DesignReductions *reduce = self->level->reductions;

    self->sliding(now, tangent->turning, in, slide);
    for (int leg = 0; leg < 3; ++leg) {
        double *const *of = slide + leg; /* position, speed, and how they change */
        reduce->track(now, of[0], of[6], -1.0, start, &tangent->low[leg]);
        reduce->track(now, of[0], of[6], 1.0, start, &tangent->high[leg]);
        reduce->track_size(now, of[3], of[9], start, &tangent->speed[leg]);
        if (self->asked & ASK_POWER) {
            const ptrdiff_t to = leg * self->motion.padded + start;
            reduce->power_rates(now, force[leg], force[3 + leg], of[3], of[9], tangent->power + to,
                                tangent->rate + to);
        }
    }
}

static void tangent_samples(const DesignLoop *self, Tangent *tangent, Run *forces)
{
    const DesignMotion *motion = &self->motion;
    const DesignReductions *reduce = self->level->reductions;
    const double *offset = tangent->offset, *in[DESIGN_INPUTS];
    const int shifted = offset[0] != 0.0 || offset[1] != 0.0 || offset[2] != 0.0;
    double *line[LINES_OF_TANGENT];

    for (int k = 0; k < LINES_OF_TANGENT; ++k)
        line[k] = tangent->scratch + k * DESIGN_LINE;
    double *const *force = line + 4, *const *slide = line + 10, *const *margin = line + 22, *zeros = line[24];
    memset(zeros, 0, DESIGN_LINE * sizeof(double));
    for (ptrdiff_t start = 0, now; start < motion->padded; start += now) {
        now = motion->padded - start < DESIGN_BLOCK ? motion->padded - start : DESIGN_BLOCK;
        for (int k = 0; k < DESIGN_INPUTS; ++k)
            in[k] = motion->rows + k * motion->padded + start;
        if (shifted) {
            reduce->place(motion, offset, start, now, line);
            for (int k = 0; k < 4; ++k)
                in[k] = line[k];
        }
        forces(now, tangent->constants, in, force);
        for (int leg = 0; leg < 3; ++leg) {
            reduce->track_size(now, force[leg], force[3 + leg], start, &tangent->peak[leg]);
            reduce->products(now, motion->mean + start, force[leg], force[3 + leg], tangent->square[leg],
                             tangent->product[leg]);
        }
        reduce->margins(tangent->lengths, now, in, margin[0], margin[1]);
        reduce->track(now, margin[0], zeros, 1.0, start, &tangent->demand);
        reduce->track(now, margin[1], zeros, -1.0, start, &tangent->angle);
        if (self->asked & (ASK_SLIDERS | ASK_POWER))
            slide_tangent(self, tangent, start, now, in, force, slide);
    }
}

/* How the work changes that is given more in a step in which the power turns than in the step as a whole. */
static double rate_of_turn(const DesignMotion *motion, const double *power, const double *rate, ptrdiff_t i,
                           double step, double step_rate)
{
    const ptrdiff_t points = motion->points, last = motion->samples - points;
    const double gap = power[i] - power[i + 1], share = power[i] / gap;
    const double moved = (power[i] * rate[i + 1] - power[i + 1] * rate[i]) / (gap * gap); /* of the share */
    const double *weight = motion->partial + i * points * points;
    ptrdiff_t from = i - (points / 2 - 1);
    double part = 0.0, part_rate = 0.0;

    from = from < 0 ? 0 : from > last ? last : from;
    for (ptrdiff_t m = points - 1; m >= 0; --m) {
        double coefficient = 0.0, its_rate = 0.0;
        for (ptrdiff_t k = 0; k < points; ++k) {
            coefficient += weight[m * points + k] * power[from + k];
            its_rate += weight[m * points + k] * rate[from + k];
        }
        part_rate = (part_rate + its_rate) * share + (part + coefficient) * moved;
        part = (part + coefficient) * share;
    }
    const double rest = step - part, rest_rate = step_rate - part_rate;
    return (part > 0.0 ? part_rate : 0.0) + (rest > 0.0 ? rest_rate : 0.0) - (step > 0.0 ? step_rate : 0.0);
}

static double given_rate(const DesignLoop *self, const double *power, const double *rate, double *step,
                         ptrdiff_t *turns)
{
    const DesignMotion *motion = &self->motion;
    double *step_rate = step + motion->padded, sums[DESIGN_LANES] = {0.0};

    self->level->reductions->steps(motion, power, step);
    self->level->reductions->steps(motion, rate, step_rate);
    self->level->reductions->positive_rates(motion->padded, step, step_rate, sums);
    double found = sum_of(sums);
    const ptrdiff_t count = self->level->reductions->turns(motion->samples, power, turns);
    for (ptrdiff_t k = 0; k < count; ++k)
        found += rate_of_turn(motion, power, rate, turns[k], step[turns[k]], step_rate[turns[k]]);
    return found;
}

static void write_power_rates(const DesignLoop *self, Tangent *tangent, double *out)
{
    const DesignMotion *motion = &self->motion;
    const DesignReductions *reduce = self->level->reductions;
    double *step = tangent->rate + 3 * motion->padded;

    for (int leg = 0; leg < 3; ++leg) {
        const double *power = tangent->power + leg * motion->padded, *rate = tangent->rate + leg * motion->padded;
        DesignTrack most, least;
        double work[DESIGN_LANES] = {0.0};
        start_track(&most);
        start_track(&least);
        reduce->track(motion->padded, power, rate, 1.0, 0, &most);
        reduce->track(motion->padded, power, rate, -1.0, 0, &least);
        reduce->weighted(motion->padded, motion->work, rate, work);
        out[AT_POWER + leg] = most.top[first_lane(&most)] > 0.0 ? rate_of(&most) : 0.0;
        out[AT_BRAKING + leg] = least.top[first_lane(&least)] > 0.0 ? rate_of(&least) : 0.0;
        out[AT_WORK + leg] = sum_of(work);
        out[AT_GIVEN + leg] = given_rate(self, power, rate, step, tangent->turns);
    }
}

static void run_tangent(const DesignLoop *self, Tangent *tangent, Run *forces, double *out)
{
    for (int k = 0; k < self->width; ++k)
        out[k] = NAN;
    start_tangent(tangent);
    tangent_samples(self, tangent, forces);
    out[AT_REACH] = reach_rate(self, tangent);
    if (self->asked & ASK_SINGULAR)
        out[AT_ANGLE] = angle_rate(self, tangent);
    for (int leg = 0; leg < 3; ++leg) {
        out[AT_PEAK + leg] = rate_of(&tangent->peak[leg]);
        out[AT_SQUARE + leg] = sum_of(tangent->product[leg]) / sqrt(sum_of(tangent->square[leg]));
        if (!(self->asked & (ASK_SLIDERS | ASK_POWER)))
            continue;
        out[AT_LOW + leg] = -rate_of(&tangent->low[leg]);
        out[AT_HIGH + leg] = rate_of(&tangent->high[leg]);
        out[AT_SPEED + leg] = rate_of(&tangent->speed[leg]);
    }
    if (self->asked & ASK_POWER)
        write_power_rates(self, tangent, out);
}

static int run_tangents(const DesignLoop *self, const DesignTables *tables, int symmetric)
{
    const size_t scratch = LINES_OF_TANGENT * DESIGN_LINE, padded = (size_t)self->motion.padded;
    double *room = malloc((scratch + 8 * padded + CACHE_LINE) * sizeof(double));
    ptrdiff_t *turns = malloc(padded * sizeof(ptrdiff_t));
    Tangent tangent;

    if (!room || !turns) {
        free(room);
        free(turns);
        return -1;
    }
    memset(&tangent, 0, sizeof tangent);
    tangent.scratch = room + CACHE_LINE - (uintptr_t)room / sizeof(double) % CACHE_LINE;
    tangent.power = tangent.scratch + scratch;
    tangent.rate = tangent.power + 3 * padded;
    tangent.turns = turns;
    for (Py_ssize_t k = 0; k < tables->designs; ++k) {
        tangent.constants = tables->constants + k * self->tangent_constants[symmetric];
        tangent.turning = tables->turning ? tables->turning + k * self->sliding_constants : NULL;
        tangent.lengths = tables->lengths + LENGTH_NUMBERS * k;
        tangent.offset = tables->offsets ? tables->offsets + 3 * k : NOWHERE;
        run_tangent(self, &tangent, self->tangents[symmetric], tables->out + k * self->width);
    }
    free(room);
    free(turns);
    return 0;
}

static PyObject *DesignLoop_tangent(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    const DesignLoop *self = (const DesignLoop *)object;
    DesignTables tables;
    int done = -1;

    if (count != 6) {
        PyErr_SetString(PyExc_TypeError, "tangent takes whether bodies are symmetric, constants, those of the sliders, "
                                         "lengths, offsets and results, by position");
        return NULL;
    }
    const int symmetric = PyObject_IsTrue(args[0]);
    if (symmetric < 0)
        return NULL;
    if (symmetric && !self->tangents[1]) {
        PyErr_SetString(PyExc_ValueError, "with friction there is no form for symmetric bodies");
        return NULL;
    }
    const TableWidths widths = {self->tangent_constants[symmetric], self->sliding_constants, LENGTH_NUMBERS,
                                self->width};
    if (args[2] == Py_None && self->asked & (ASK_SLIDERS | ASK_POWER)) {
        PyErr_SetString(PyExc_TypeError, "sliders are asked for: their constants must be a buffer of doubles");
        return NULL;
    }
    memset(&tables, 0, sizeof tables);
    if (take_tables(widths, args + 1, &tables) == 0) {
        Py_BEGIN_ALLOW_THREADS
        done = run_tangents(self, &tables, symmetric);
        Py_END_ALLOW_THREADS
        if (done < 0)
            PyErr_NoMemory();
    }
    while (tables.held)
        PyBuffer_Release(&tables.views[--tables.held]);
    if (done < 0)
        return NULL;
    Py_RETURN_NONE;
}

PyDoc_STRVAR(DesignLoop_tangent_doc,
             "tangent(symmetric, constants, turning, lengths, offsets, results)\n--\n\n"
             "How the figures of designs change along a direction each: rows as the call itself writes them.\n\n"
             "The constants are those of the kernels of tangents, `lengths` has r, R, L, how they change, and how\n"
             "y, z and theta do. What has no derivative is NaN. Designs that cannot are computed all the same.");
