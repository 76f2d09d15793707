/* DOP853: the explicit Runge-Kutta method of order 8 with steps of its own choice, and a dense output of order 7.
 *
 * The method and its coefficients: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I,
 * Springer 1993, II.4-6. First step, norm of the error and control of the step are those of scipy.integrate.DOP853,
 * so that both take the same steps but for rounding.
 *
 * Where steps end soon because something changes there, such as forces, their error is far below what is allowed, and
 * order 8 is wasted: `at_once` tries to get there by six evaluations in all, instead of thirteen. Where that is not good
 * enough, and within such a step, all is DOP853's.
 *
 * Included, or pasted, once for each system of equations, with these defined before:
 *
 *   DOP853_NAME(f)                      a name of its own for f;
 *   DOP853_SIZE                         how many numbers a state has;
 *   DOP853_CONTEXT                      a type: what the rate needs, such as `const struct machine *`;
 *   DOP853_RATE(context, t, y, rate)    writes the derivative of y[DOP853_SIZE] at t; NaN where there is none;
 *   DOP853_TARGET                       attributes of every function, or nothing.
 *
 * C99, and <float.h>, <math.h> included before. There is no include guard, for it may serve several systems.
 *
 *     DOP853_NAME(solver) s;
 *     if (DOP853_NAME(start)(&s, context, t, y, bound, 0.0, rtol, atol, INFINITY))
 *         while (DOP853_NAME(step)(&s, context) == DOP853_RUNNING) {
 *             DOP853_NAME(interpolate)(&s, context);      three more evaluations, only if this step is looked into
 *             DOP853_NAME(at)(&s, s.t_old + 0.5 * (s.t - s.t_old), y);
 *         }
 */
#ifndef DOP853_STATUS
#define DOP853_STATUS
enum {
    DOP853_RUNNING, /* a step was taken, there are more */
    DOP853_FINISHED, /* a step was taken, the last */
    DOP853_FAILED,   /* no step is small enough; t and y are as before */
};
#define DOP853_SHARE 0.015 /* of the error that is allowed: what that of `at_once` may be */
#define DOP853_PATIENCE 63 /* how many intervals it waits at most, where it was of no use */
#endif

typedef struct {
    double t, y[DOP853_SIZE];           /* the end of the last step */
    double t_old, y_old[DOP853_SIZE];   /* its beginning */
    double next;                        /* length of the next step, the control of the error permitting */
    double bound, longest, rtol, atol;
    double k[16][DOP853_SIZE];          /* rates of the last step; k[12] is that at its end */
    double curve[7][DOP853_SIZE];       /* its dense output */
    int once;                           /* whether it was made by `at_once` */
    long evaluations;
} DOP853_NAME(solver);

static DOP853_TARGET void DOP853_NAME(evaluate)(DOP853_NAME(solver) * s, DOP853_CONTEXT context, double t,
                                                const double *y, double *rate)
{
    ++s->evaluations;
    DOP853_RATE(context, t, y, rate);
}

static DOP853_TARGET double DOP853_NAME(scale)(const DOP853_NAME(solver) * s, double a, double b)
{
    const double x = fabs(a), y = fabs(b);
    return s->atol + (x > y ? x : y) * s->rtol;
}

/* The first step: Hairer, Norsett, Wanner, II.4. */
static DOP853_TARGET double DOP853_NAME(first_step)(DOP853_NAME(solver) * s, DOP853_CONTEXT context)
{
    const double span = s->bound - s->t, *f0 = s->k[12];
    double d0 = 0.0, d1 = 0.0, d2 = 0.0, y1[DOP853_SIZE], f1[DOP853_SIZE];
    for (int i = 0; i < DOP853_SIZE; ++i) {
        const double scale = DOP853_NAME(scale)(s, s->y[i], 0.0);
        d0 += (s->y[i] / scale) * (s->y[i] / scale);
        d1 += (f0[i] / scale) * (f0[i] / scale);
    }
    d0 = sqrt(d0 / DOP853_SIZE);
    d1 = sqrt(d1 / DOP853_SIZE);
    double h0 = d0 < 1e-5 || d1 < 1e-5 ? 1e-6 : 0.01 * d0 / d1;
    h0 = h0 < span ? h0 : span;
    for (int i = 0; i < DOP853_SIZE; ++i)
        y1[i] = s->y[i] + h0 * f0[i];
    DOP853_NAME(evaluate)(s, context, s->t + h0, y1, f1);
    for (int i = 0; i < DOP853_SIZE; ++i) {
        const double change = (f1[i] - f0[i]) / DOP853_NAME(scale)(s, s->y[i], 0.0);
        d2 += change * change;
    }
    d2 = sqrt(d2 / DOP853_SIZE) / h0;
    const double steepest = d2 > d1 ? d2 : d1; /* d1, if the other is NaN */
    double h1 = h0 * 1e-3 > 1e-6 ? h0 * 1e-3 : 1e-6;
    if (!(d1 <= 1e-15 && d2 <= 1e-15))
        h1 = sqrt(sqrt(sqrt(0.01 / steepest)));
    double h = 100.0 * h0 < h1 ? 100.0 * h0 : h1;
    h = h < span ? h : span;
    return h < s->longest ? h : s->longest;
}

/* Begin at a time and state; `first` is the first step, zero to choose one. Return whether the derivative there, and
 * the step, are finite. `evaluations` begins with zero. */
static DOP853_TARGET int DOP853_NAME(start)(DOP853_NAME(solver) * s, DOP853_CONTEXT context, double t, const double *y,
                                            double bound, double first, double rtol, double atol, double longest)
{
    int finite = 1;
    s->t = s->t_old = t;
    s->bound = bound;
    s->rtol = rtol;
    s->atol = atol;
    s->longest = longest;
    s->once = 0;
    s->evaluations = 0;
    for (int i = 0; i < DOP853_SIZE; ++i)
        s->y[i] = s->y_old[i] = y[i];
    DOP853_NAME(evaluate)(s, context, t, s->y, s->k[12]);
    s->next = first > 0.0 ? first : DOP853_NAME(first_step)(s, context);
    for (int i = 0; i < DOP853_SIZE; ++i)
        finite &= fabs(s->k[12][i]) <= DBL_MAX;
    return finite && fabs(s->next) <= DBL_MAX;
}

/* Positions apart from velocities: they need not wait for the last accelerations. */
#define K(j) s->k[j][i]
#define DOP853_STAGE(stage, c, sum)                                         \
    for (int i = 0; i < DOP853_SIZE / 2; ++i)                               \
        trial[i] = s->y_old[i] + h * (sum);                                 \
    for (int i = DOP853_SIZE / 2; i < DOP853_SIZE; ++i)                     \
        trial[i] = s->y_old[i] + h * (sum);                                 \
    DOP853_NAME(evaluate)(s, context, s->t_old + (c) * h, trial, s->k[stage])

/* Take a step of a length from t_old, y_old to y, and return the norm of its error. */
static DOP853_TARGET double DOP853_NAME(try_step)(DOP853_NAME(solver) * s, DOP853_CONTEXT context, double h)
{
    double trial[DOP853_SIZE], norm5 = 0.0, norm3 = 0.0;

    DOP853_STAGE(1, 0.05260015195876773,
                 0.05260015195876773 * K(0));
    DOP853_STAGE(2, 0.0789002279381516,
                 0.0197250569845379 * K(0) + 0.0591751709536137 * K(1));
    DOP853_STAGE(3, 0.1183503419072274,
                 0.02958758547680685 * K(0) + 0.08876275643042054 * K(2));
    DOP853_STAGE(4, 0.2816496580927726,
                 0.2413651341592667 * K(0) - 0.8845494793282861 * K(2) + 0.924834003261792 * K(3));
    DOP853_STAGE(5, 0.3333333333333333,
                 0.037037037037037035 * K(0) + 0.17082860872947386 * K(3) + 0.12546768756682242 * K(4));
    DOP853_STAGE(6, 0.25,
                 0.037109375 * K(0) + 0.17025221101954405 * K(3) + 0.06021653898045596 * K(4)
                 - 0.017578125 * K(5));
    DOP853_STAGE(7, 0.3076923076923077,
                 0.03709200011850479 * K(0) + 0.17038392571223998 * K(3) + 0.10726203044637328 * K(4)
                 - 0.015319437748624402 * K(5) + 0.008273789163814023 * K(6));
    DOP853_STAGE(8, 0.6512820512820513,
                 0.6241109587160757 * K(0) - 3.3608926294469414 * K(3) - 0.868219346841726 * K(4)
                 + 27.59209969944671 * K(5) + 20.154067550477894 * K(6) - 43.48988418106996 * K(7));
    DOP853_STAGE(9, 0.6,
                 0.47766253643826434 * K(0) - 2.4881146199716677 * K(3) - 0.590290826836843 * K(4)
                 + 21.230051448181193 * K(5) + 15.279233632882423 * K(6) - 33.28821096898486 * K(7)
                 - 0.020331201708508627 * K(8));
    DOP853_STAGE(10, 0.8571428571428571,
                 -0.9371424300859873 * K(0) + 5.186372428844064 * K(3) + 1.0914373489967295 * K(4)
                 - 8.149787010746927 * K(5) - 18.52006565999696 * K(6) + 22.739487099350505 * K(7)
                 + 2.4936055526796523 * K(8) - 3.0467644718982196 * K(9));
    DOP853_STAGE(11, 1.0,
                 2.273310147516538 * K(0) - 10.53449546673725 * K(3) - 2.0008720582248625 * K(4)
                 - 17.9589318631188 * K(5) + 27.94888452941996 * K(6) - 2.8589982771350235 * K(7)
                 - 8.87285693353063 * K(8) + 12.360567175794303 * K(9) + 0.6433927460157636 * K(10));
    for (int i = 0; i < DOP853_SIZE; ++i)
        s->y[i] = s->y_old[i] +
                  h * (0.054293734116568765 * K(0) + 4.450312892752409 * K(5)
                                + 1.8915178993145003 * K(6) - 5.801203960010585 * K(7)
                                + 0.3111643669578199 * K(8) - 0.1521609496625161 * K(9)
                                + 0.20136540080403034 * K(10) + 0.04471061572777259 * K(11));
    DOP853_NAME(evaluate)(s, context, s->t_old + h, s->y, s->k[12]);
    for (int i = 0; i < DOP853_SIZE; ++i) {
        const double scale = DOP853_NAME(scale)(s, s->y_old[i], s->y[i]);
        const double error5 =
            (0.01312004499419488 * K(0) - 1.2251564463762044 * K(5) - 0.4957589496572502 * K(6)
                     + 1.6643771824549864 * K(7) - 0.35032884874997366 * K(8) + 0.3341791187130175 * K(9)
                     + 0.08192320648511571 * K(10) - 0.022355307863886294 * K(11)) / scale;
        const double error3 =
            (-0.18980075407240762 * K(0) + 4.450312892752409 * K(5) + 1.8915178993145003 * K(6)
                     - 5.801203960010585 * K(7) - 0.4226823213237919 * K(8) - 0.1521609496625161 * K(9)
                     + 0.20136540080403034 * K(10) + 0.02265179219836082 * K(11)) / scale;
        norm5 += error5 * error5;
        norm3 += error3 * error3;
    }
    if (norm5 == 0.0 && norm3 == 0.0)
        return 0.0;
    return h * norm5 / sqrt((norm5 + 0.01 * norm3) * DOP853_SIZE);
}

/* Right after `start`, go to the bound in one step of order 5, where the next step would go there too and the error is small:
 * J. R. Cash, A. H. Karp, ACM Transactions on Mathematical Software 16 (1990), 201-222. Return whether it was taken; if
 * not, nothing has changed, and `step` goes on. The rate at its end is left out: another interval begins there.
 * `trials`: how many intervals to wait, now and after the last trial; they begin with zero. */
static inline DOP853_TARGET int DOP853_NAME(at_once)(DOP853_NAME(solver) * s, DOP853_CONTEXT context, int trials[2])
{
    const double h = s->bound - s->t;
    double trial[DOP853_SIZE], square = 0.0;

    if (trials[0] > 0) {
        --trials[0];
        return 0;
    }
    if (!(s->next >= h && s->longest >= h))
        return 0;
    DOP853_STAGE(1, 0.2, 0.2 * K(12));
    DOP853_STAGE(2, 0.3, 0.075 * K(12) + 0.225 * K(1));
    DOP853_STAGE(3, 0.6, 0.3 * K(12) - 0.9 * K(1) + 1.2 * K(2));
    DOP853_STAGE(4, 1.0,
                 -0.2037037037037037 * K(12) + 2.5 * K(1) - 2.5925925925925926 * K(2) + 1.2962962962962963 * K(3));
    DOP853_STAGE(5, 0.875,
                 0.029495804398148147 * K(12) + 0.341796875 * K(1) + 0.041594328703703706 * K(2)
                 + 0.4003454137731481 * K(3) + 0.061767578125 * K(4));
    for (int i = 0; i < DOP853_SIZE; ++i)
        s->y[i] = s->y_old[i] + h * (0.09788359788359788 * K(12) + 0.4025764895330113 * K(2)
                                     + 0.21043771043771045 * K(3) + 0.2891022021456804 * K(5));
    for (int i = 0; i < DOP853_SIZE; ++i) {
        const double error =
            (-0.004293774801587302 * K(12) + 0.018668586093857853 * K(2) - 0.034155026830808075 * K(3)
             - 0.019321986607142856 * K(4) + 0.03910220214568041 * K(5)) / DOP853_NAME(scale)(s, s->y_old[i], s->y[i]);
        square += error * error;
    }
    s->once = h * h * square < DOP853_SHARE * DOP853_SHARE * DOP853_SIZE; /* not if it is NaN */
    trials[0] = trials[1] = s->once ? 0 : trials[1] < DOP853_PATIENCE ? 2 * trials[1] + 1 : DOP853_PATIENCE;
    if (s->once) {
        s->next = 10.0 * h;
        s->t = s->bound;
    }
    else {
        for (int i = 0; i < DOP853_SIZE; ++i)
            s->y[i] = s->y_old[i];
    }
    return s->once;
}

/* Take a step: as long as the error permits, and not beyond the bound. */
static DOP853_TARGET int DOP853_NAME(step)(DOP853_NAME(solver) * s, DOP853_CONTEXT context)
{
    const double least = 10.0 * (nextafter(s->t, INFINITY) - s->t);
    double length = s->next > s->longest ? s->longest : s->next < least ? least : s->next, y[DOP853_SIZE];
    int refused = 0;

    s->t_old = s->t;
    for (int i = 0; i < DOP853_SIZE; ++i) {
        y[i] = s->y[i];
        s->y_old[i] = s->y[i];
        s->k[0][i] = s->k[12][i];
    }
    while (length >= least) { /* and is a number */
        const double end = s->t_old + length > s->bound ? s->bound : s->t_old + length;
        length = end - s->t_old;
        const double norm = DOP853_NAME(try_step)(s, context, length);
        const double factor = 0.9 / sqrt(sqrt(sqrt(norm)));
        if (norm < 1.0) {
            s->next = length * (refused && factor > 1.0 ? 1.0 : factor < 10.0 ? factor : 10.0);
            s->t = end;
            return end >= s->bound ? DOP853_FINISHED : DOP853_RUNNING;
        }
        length *= factor > 0.2 ? factor : 0.2; /* also if it is NaN */
        refused = 1;
    }
    for (int i = 0; i < DOP853_SIZE; ++i) {
        s->y[i] = y[i];
        s->k[12][i] = s->k[0][i];
    }
    return DOP853_FAILED;
}

/* Make the dense output of the last step: three more evaluations, or all fifteen where it was taken at once. */
static DOP853_TARGET void DOP853_NAME(interpolate)(DOP853_NAME(solver) * s, DOP853_CONTEXT context)
{
    const double h = s->t - s->t_old;
    double trial[DOP853_SIZE];

    if (s->once) { /* its end stays */
        double y[DOP853_SIZE];
        for (int i = 0; i < DOP853_SIZE; ++i) {
            y[i] = s->y[i];
            s->k[0][i] = s->k[12][i];
        }
        DOP853_NAME(try_step)(s, context, h);
        for (int i = 0; i < DOP853_SIZE; ++i)
            s->y[i] = y[i];
        s->once = 0;
    }
    DOP853_STAGE(13, 0.1,
                 0.056167502283047954 * K(0) + 0.25350021021662483 * K(6) - 0.2462390374708025 * K(7)
                 - 0.12419142326381637 * K(8) + 0.15329179827876568 * K(9) + 0.00820105229563469 * K(10)
                 + 0.007567897660545699 * K(11) - 0.008298 * K(12));
    DOP853_STAGE(14, 0.2,
                 0.03183464816350214 * K(0) + 0.028300909672366776 * K(5) + 0.053541988307438566 * K(6)
                 - 0.05492374857139099 * K(7) - 0.00010834732869724932 * K(10) + 0.0003825710908356584 * K(11)
                 - 0.00034046500868740456 * K(12) + 0.1413124436746325 * K(13));
    DOP853_STAGE(15, 0.7777777777777778,
                 -0.42889630158379194 * K(0) - 4.697621415361164 * K(5) + 7.683421196062599 * K(6)
                 + 4.06898981839711 * K(7) + 0.3567271874552811 * K(8) - 0.0013990241651590145 * K(12)
                 + 2.9475147891527724 * K(13) - 9.15095847217987 * K(14));
    for (int i = 0; i < DOP853_SIZE; ++i) {
        const double change = s->y[i] - s->y_old[i];
        s->curve[0][i] = change;
        s->curve[1][i] = h * K(0) - change;
        s->curve[2][i] = 2.0 * change - h * (K(12) + K(0));
        s->curve[3][i] = h * (-8.428938276109013 * K(0) + 0.5667149535193777 * K(5) - 3.0689499459498917 * K(6)
                             + 2.38466765651207 * K(7) + 2.117034582445028 * K(8) - 0.871391583777973 * K(9)
                             + 2.2404374302607883 * K(10) + 0.6315787787694688 * K(11)
                             - 0.08899033645133331 * K(12) + 18.148505520854727 * K(13)
                             - 9.194632392478356 * K(14) - 4.436036387594894 * K(15));
        s->curve[4][i] = h * (10.427508642579134 * K(0) + 242.28349177525817 * K(5) + 165.20045171727028 * K(6)
                             - 374.5467547226902 * K(7) - 22.113666853125306 * K(8) + 7.733432668472264 * K(9)
                             - 30.674084731089398 * K(10) - 9.332130526430229 * K(11)
                             + 15.697238121770845 * K(12) - 31.139403219565178 * K(13)
                             - 9.35292435884448 * K(14) + 35.81684148639408 * K(15));
        s->curve[5][i] = h * (19.985053242002433 * K(0) - 387.0373087493518 * K(5) - 189.17813819516758 * K(6)
                             + 527.8081592054236 * K(7) - 11.57390253995963 * K(8) + 6.8812326946963 * K(9)
                             - 1.0006050966910838 * K(10) + 0.7777137798053443 * K(11)
                             - 2.778205752353508 * K(12) - 60.19669523126412 * K(13) + 84.32040550667716 * K(14)
                             + 11.99229113618279 * K(15));
        s->curve[6][i] = h * (-25.69393346270375 * K(0) - 154.18974869023643 * K(5) - 231.5293791760455 * K(6)
                             + 357.6391179106141 * K(7) + 93.40532418362432 * K(8) - 37.45832313645163 * K(9)
                             + 104.0996495089623 * K(10) + 29.8402934266605 * K(11) - 43.53345659001114 * K(12)
                             + 96.32455395918828 * K(13) - 39.17726167561544 * K(14)
                             - 149.72683625798564 * K(15));
    }
}
#undef DOP853_STAGE
#undef K

/* Write the state at a time within the last step, after `interpolate`. */
static DOP853_TARGET void DOP853_NAME(at)(const DOP853_NAME(solver) * s, double t, double *y)
{
    const double x = (t - s->t_old) / (s->t - s->t_old), rest = 1.0 - x;
    const double(*c)[DOP853_SIZE] = s->curve;
    for (int i = 0; i < DOP853_SIZE; ++i) {
        const double high = c[3][i] + x * (c[4][i] + rest * (c[5][i] + x * c[6][i]));
        y[i] = s->y_old[i] + x * (c[0][i] + rest * (c[1][i] + x * (c[2][i] + rest * high)));
    }
}
