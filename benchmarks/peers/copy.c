/* What a copy of large arrays reaches on this machine: the ruler that the step is held against.
 *
 * Plain stores, as a step has them, no memcpy with its stores past the cache; so each number is read,
 * the line that it goes to is fetched (write-allocate) and written back: three times its eight bytes.
 *
 *     cc -O3 -march=native -fopenmp copy.c -o copy && OMP_NUM_THREADS=2 ./copy
 */
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>

enum { COUNT = 1 << 25, ROUNDS = 7 }; /* 256 MiB an array */

int main(int count, char **words) {
    double *from = malloc(COUNT * sizeof *from), *to = malloc(COUNT * sizeof *to);
    if (!from || !to) return 1;
    const double factor = count > 1 ? atof(words[1]) : 1; /* unknown to the compiler: no memcpy */
#pragma omp parallel for schedule(static)
    for (int n = 0; n < COUNT; n++) from[n] = n, to[n] = 0;
    double best = 1e9;
    for (int round = 0; round < ROUNDS; round++) {
        double begun = omp_get_wtime();
#pragma omp parallel for schedule(static)
        for (int n = 0; n < COUNT; n++) to[n] = factor * from[n];
        double taken = omp_get_wtime() - begun;
        if (taken < best) best = taken;
    }
    printf("%.2f GB/s check %g\n", 3e-9 * COUNT * sizeof *from / best, to[COUNT / 2]);
    return 0;
}
