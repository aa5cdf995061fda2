// Elimination within one matrix, in place: vip_factors/solve/fixed_lag.py, by SciPy's own BLAS and LAPACK.
//
// Matrices are stored by rows, of which only the triangle above the diagonal counts: to BLAS, which stores by columns,
// that is the triangle below the diagonal.
#pragma once
#include <cstdint>

namespace vip {

struct Blas {
    void (*dpotrf)(const char*, int*, double*, int*, int*);
    void (*dtrsm)(const char*, const char*, const char*, const char*, int*, int*, double*, double*, int*, double*, int*);
    void (*dsyrk)(const char*, const char*, int*, int*, double*, double*, int*, double*, double*, int*);
    void (*dtrsv)(const char*, const char*, const char*, int*, double*, int*, double*, int*);
    void (*dgemv)(const char*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
    void (*dsymv)(const char*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
};

inline double ONE = 1.0, MINUS_ONE = -1.0;
inline int NEXT = 1;

// The first w variables of ½ xᵀ M x − vᵀ x out of n, in rows of which each begins `row` behind the last: then M holds R
// and S in its first rows, and what is said of the others behind them; so does v. False if they are not determined.
inline bool eliminate(const Blas& blas, double* M, double* v, int row, int n, int w) {
    int rest = n - w, failed = 0;
    if (w == 0) return true;
    blas.dpotrf("L", &w, M, &row, &failed);
    if (failed) return false;
    blas.dtrsv("L", "N", "N", &w, M, &row, v, &NEXT);
    if (rest == 0) return true;
    blas.dtrsm("R", "L", "T", "N", &rest, &w, &ONE, M, &row, M + w, &row);
    blas.dsyrk("L", "N", &rest, &w, &MINUS_ONE, M + w, &row, &ONE, M + (row + 1) * static_cast<int64_t>(w), &row);
    blas.dgemv("N", &rest, &w, &MINUS_ONE, M + w, &row, v, &NEXT, &ONE, v + w, &NEXT);
    return true;
}

// x of R x + S y = x as it was, of w rows of M.
inline void substitute(const Blas& blas, double* M, int row, int n, int w, double* y, double* x) {
    int rest = n - w;
    if (w == 0) return;
    if (rest > 0) blas.dgemv("T", &rest, &w, &MINUS_ONE, M + w, &row, y, &NEXT, &ONE, x, &NEXT);
    blas.dtrsv("L", "T", "N", &w, M, &row, x, &NEXT);
}

// Adds what lies on and above the diagonal: of the first `head` columns of a matrix to the first of another, and of
// its last `tail` ones to the last.
inline void add_upper(const double* from, int64_t row, int64_t head, int64_t tail, double* M, int64_t n) {
    for (int64_t i = 0; i < head + tail; i++) {
        const double* source = from + i * row;
        double *into = M + (i < head ? i : n - tail + i - head) * n, *last = into + n - tail;
        for (int64_t j = i; j < head; j++) into[j] += source[j];
        for (int64_t j = i < head ? 0 : i - head; j < tail; j++) last[j] += source[head + j];
    }
}

}  // namespace vip
