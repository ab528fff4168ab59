/* The cost of one elastic-damage step in hand-written C: this project's practical yardstick.
 *
 * The same two passes as taichi_ldem/dynamics.py (bar scalars, then gather and integrate) on plain
 * arrays, one component each, x innermost, left to the compiler to vectorise, OpenMP over rows. It is no
 * solver: no contact, no surface weights, no sampling, every bar reads and writes its history.
 *
 *     cc -DREAL=double -O3 -march=native -ffast-math -fopenmp lattice_step.c -o step -lm
 *     ./step NX NY NZ STEPS        prints ms a step and million bars a second
 */
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <tgmath.h> /* sqrt of a float in float: the other one would halve the lanes */

#ifndef REAL
#define REAL double
#endif
typedef REAL real;

enum { LONGITUDINAL = 3, DIAGONAL = 8, BARS = 2 * LONGITUDINAL + DIAGONAL };

static const real EDGE = 0.0928 / 174, YOUNG = 3.35e9, DENSITY = 1190, STEP = 9e-8;
static const real PEAK = 0.01747, LIMIT = 0.02301;

static int nx, ny, nz, row, plane, size;
static real *u[2][3], *v[2][3], *axial[BARS], *peak[BARS];

static real *zeros(void) {
    real *p = aligned_alloc(64, ((size_t)size * sizeof(real) + 63) / 64 * 64);
    if (!p) exit(1);
#pragma omp parallel for schedule(static) /* pages go to the thread that works on them */
    for (int n = 0; n < size; n++) p[n] = 0;
    return p;
}

/* Pass 1 for one bar of a row of sites: strain, history, axial force over current length. */
static inline void bar(int b, real *const *from, real *const *to, int reach, real x, real y, real z,
                       real length, real stiffness, int start, int end) {
    const real *restrict fx = from[0], *restrict fy = from[1], *restrict fz = from[2];
    const real *restrict tx = to[0], *restrict ty = to[1], *restrict tz = to[2];
    real *restrict history = peak[b], *restrict out = axial[b];
    const real per_square = 1 / (length * length), span = LIMIT - PEAK;
#pragma omp simd
    for (int n = start; n < end; n++) {
        real dx = tx[n + reach] - fx[n], dy = ty[n + reach] - fy[n], dz = tz[n + reach] - fz[n];
        real q = (2 * (x * dx + y * dy + z * dz) + dx * dx + dy * dy + dz * dz) * per_square;
        real ratio = sqrt(1 + q), strain = q / (1 + ratio);
        real most = history[n] > strain ? history[n] : strain;
        history[n] = most;
        real damage = LIMIT * (most - PEAK) / ((most + (real)1e-12) * span);
        damage = damage < 0 ? 0 : damage > 1 ? 1 : damage;
        real kept = strain > 0 ? 1 - damage : most < LIMIT ? 1 : 0;
        out[n] = stiffness * strain * kept / ratio;
    }
}

static int diagonal_reach(int d) { return (d >> 2) * plane + (d >> 1 & 1) * row + (d & 1); }

static void bar_forces(int start, int end) {
    const real soft = (real)0.4 * YOUNG * EDGE, diagonal = EDGE * sqrt((real)3) / 2;
    const real stiff = (real)1.299038 * (real)0.4 * YOUNG * EDGE * EDGE / diagonal;
    const int reach[LONGITUDINAL] = {1, row, plane};
    for (int s = 0; s < 2; s++)
        for (int a = 0; a < LONGITUDINAL; a++)
            bar(LONGITUDINAL * s + a, u[s], u[s], reach[a], (a == 0) * EDGE, (a == 1) * EDGE,
                (a == 2) * EDGE, EDGE, soft, start, end);
    for (int d = 0; d < DIAGONAL; d++)
        bar(2 * LONGITUDINAL + d, u[1], u[0], diagonal_reach(d), ((d & 1) - (real)0.5) * EDGE,
            ((d >> 1 & 1) - (real)0.5) * EDGE, ((d >> 2) - (real)0.5) * EDGE, diagonal, stiff, start, end);
}

/* One bar at a node: F is its scalar, M its other end at (X, Y, Z) from here, in units of EDGE. */
#define PULL(F, M, X, Y, Z, tx, ty, tz)        \
    {                                          \
        const real f = (F);                    \
        fx += f * ((X) * EDGE + tx[M] - x);    \
        fy += f * ((Y) * EDGE + ty[M] - y);    \
        fz += f * ((Z) * EDGE + tz[M] - z);    \
    }
#define EDGES(f, reach, X, Y, Z)                         \
    PULL(f[n], n + reach, X, Y, Z, ax, ay, az)           \
    PULL(f[n - reach], n - reach, -X, -Y, -Z, ax, ay, az)
#define HALF(bit) (side * ((bit) - (real)0.5))
#define DIAGONAL_PULL(d)                                                                        \
    {                                                                                           \
        const int m = n + side * ((d >> 2) * over + (d >> 1 & 1) * across + (d & 1));           \
        PULL(axial[2 * LONGITUDINAL + d][s ? n : m], m, HALF(d & 1), HALF(d >> 1 & 1),          \
             HALF(d >> 2), bx, by, bz)                                                          \
    }

/* Pass 2 for one row of one sublattice: sum the bars at each node, update its velocity. Written out bar by
 * bar: from loops over the bars the compiler makes gathers, which take three times as long. */
static inline __attribute__((always_inline)) void node_velocities(const int s, int start, int end) {
    const real *restrict ax = u[s][0], *restrict ay = u[s][1], *restrict az = u[s][2];
    const real *restrict bx = u[1 - s][0], *restrict by = u[1 - s][1], *restrict bz = u[1 - s][2];
    const real *restrict along_x = axial[LONGITUDINAL * s], *restrict along_y = axial[LONGITUDINAL * s + 1];
    const real *restrict along_z = axial[LONGITUDINAL * s + 2];
    real *restrict wx = v[s][0], *restrict wy = v[s][1], *restrict wz = v[s][2];
    const int side = s ? 1 : -1, across = row, over = plane;
    const real gain = STEP / ((real)0.5 * DENSITY * EDGE * EDGE * EDGE);
#pragma omp simd
    for (int n = start; n < end; n++) {
        const real x = ax[n], y = ay[n], z = az[n];
        real fx = 0, fy = 0, fz = 0;
        EDGES(along_x, 1, 1, 0, 0)
        EDGES(along_y, across, 0, 1, 0)
        EDGES(along_z, over, 0, 0, 1)
        DIAGONAL_PULL(0)
        DIAGONAL_PULL(1)
        DIAGONAL_PULL(2)
        DIAGONAL_PULL(3)
        DIAGONAL_PULL(4)
        DIAGONAL_PULL(5)
        DIAGONAL_PULL(6)
        DIAGONAL_PULL(7)
        wx[n] += gain * fx;
        wy[n] += gain * fy;
        wz[n] += gain * fz;
    }
}

/* The drift of one component over a row; a row each, so that a loop has two streams. */
static void drift(real *restrict x, const real *restrict w, int start, int end) {
#pragma omp simd
    for (int n = start; n < end; n++) x[n] += STEP * w[n];
}

static void step(void) {
#pragma omp parallel
    {
#pragma omp for collapse(2) schedule(static)
        for (int k = 1; k < nz + 2; k++)
            for (int j = 1; j < ny + 2; j++) {
                int start = (k * (ny + 3) + j) * row + 1;
                bar_forces(start, start + nx + 1);
            }
#pragma omp for collapse(2) schedule(static)
        for (int k = 1; k < nz + 2; k++)
            for (int j = 1; j < ny + 2; j++) {
                int start = (k * (ny + 3) + j) * row + 1;
                node_velocities(0, start, start + nx + 1);
                node_velocities(1, start, start + nx + 1);
            }
#pragma omp for collapse(2) schedule(static)
        for (int k = 1; k < nz + 2; k++)
            for (int j = 1; j < ny + 2; j++) {
                int start = (k * (ny + 3) + j) * row + 1;
                for (int s = 0; s < 2; s++)
                    for (int a = 0; a < 3; a++) drift(u[s][a], v[s][a], start, start + nx + 1);
            }
    }
}

int main(int count, char **words) {
    if (count != 5) return fprintf(stderr, "usage: %s NX NY NZ STEPS\n", words[0]), 2;
    nx = atoi(words[1]), ny = atoi(words[2]), nz = atoi(words[3]);
    int steps = atoi(words[4]);
    row = (nx + 3 + 15) / 16 * 16, plane = row * (ny + 3), size = plane * (nz + 3) + 2 * plane;
    for (int s = 0; s < 2; s++)
        for (int a = 0; a < 3; a++) u[s][a] = zeros(), v[s][a] = zeros();
    for (int b = 0; b < BARS; b++) axial[b] = zeros(), peak[b] = zeros();
    srand(1);
    for (int n = 0; n < size; n++)
        for (int a = 0; a < 3; a++) u[0][a][n] = (real)1e-6 * (rand() / (real)RAND_MAX - (real)0.5);
    for (int n = 0; n < 5; n++) step();
    double begun = omp_get_wtime();
    for (int n = 0; n < steps; n++) step();
    double seconds = (omp_get_wtime() - begun) / steps;
    double bars = 3.0 * nx * ny * nz - nx * ny - ny * nz - nz * nx; /* centre to centre */
    bars += nx * (ny + 1.0) * (nz + 1) + ny * (nz + 1.0) * (nx + 1) + nz * (nx + 1.0) * (ny + 1);
    bars += 8.0 * nx * ny * nz;
    double check = u[0][0][size / 2]; /* so that no work can be left out */
    printf("%.4f ms/step %.2f Mbar/s check %g\n", seconds * 1e3, bars / seconds / 1e6, check);
    return 0;
}
