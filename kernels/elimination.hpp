// Elimination within one matrix, in place: vip_factors/solve/fixed_lag.py and chain_elimination.py, by SciPy's own BLAS and LAPACK.
//
// Matrices are stored by rows, of which only the triangle above the diagonal counts: to BLAS, which stores by columns,
// that is the triangle below the diagonal.
#pragma once
#include <algorithm>
#include <cstdint>
#include <vector>

namespace vip {

struct Blas {
    void (*dpotrf)(const char*, int*, double*, int*, int*);
    void (*dtrsm)(const char*, const char*, const char*, const char*, int*, int*, double*, double*, int*, double*, int*);
    void (*dsyrk)(const char*, const char*, int*, int*, double*, double*, int*, double*, double*, int*);
    void (*dtrsv)(const char*, const char*, const char*, int*, double*, int*, double*, int*);
    void (*dgemv)(const char*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
    void (*dgemm)(const char*, const char*, int*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
};

constexpr int REACH = 2;  // frames after its own that a factor sees
inline double ONE = 1.0, MINUS_ONE = -1.0;
inline int NEXT = 1;
constexpr int SMALL = 24;  // variables that are eliminated at once

// R and S of the first w of n rows of which each begins `row` behind the last, in their place: in halves, for products of
// matrices are quicker than the substitutions that they spare. False if these variables are not determined.
inline bool factorise(const Blas& blas, double* M, int row, int n, int w) {
    if (w <= SMALL) {
        int rest = n - w, failed = 0;
        blas.dpotrf("L", &w, M, &row, &failed);
        if (!failed && rest > 0) blas.dtrsm("R", "L", "T", "N", &rest, &w, &ONE, M, &row, M + w, &row);
        return !failed;
    }
    int half = (w + 15) / 16 * 8, other = w - half, rest = n - w;
    if (!factorise(blas, M, row, n, half)) return false;
    double* then = M + (row + 1) * static_cast<int64_t>(half);
    blas.dsyrk("L", "N", &other, &half, &MINUS_ONE, M + half, &row, &ONE, then, &row);
    if (rest > 0) blas.dgemm("N", "T", &rest, &other, &half, &MINUS_ONE, M + w, &row, M + half, &row, &ONE, then + other, &row);
    return factorise(blas, then, row, n - half, other);
}

// The first w variables of ½ xᵀ M x − vᵀ x out of n, in rows of which each begins `row` behind the last: then M holds R
// and S in its first rows, and what is said of the others in `rest`, with rows of its own; so does v. False if they are
// not determined.
inline bool eliminate(const Blas& blas, double* M, double* v, int row, int n, int w, double* rest, int rest_row) {
    int others = n - w;
    if (w == 0) return true;
    if (!factorise(blas, M, row, n, w)) return false;
    blas.dtrsv("L", "N", "N", &w, M, &row, v, &NEXT);
    if (others == 0) return true;
    blas.dsyrk("L", "N", &others, &w, &MINUS_ONE, M + w, &row, &ONE, rest, &rest_row);
    blas.dgemv("N", &others, &w, &MINUS_ONE, M + w, &row, v, &NEXT, &ONE, v + w, &NEXT);
    return true;
}

// x of R x + S y = x as it was, of w rows of M.
inline void substitute(const Blas& blas, double* M, int row, int n, int w, double* y, double* x) {
    int rest = n - w;
    if (w == 0) return;
    if (rest > 0) blas.dgemv("T", &rest, &w, &MINUS_ONE, M + w, &row, y, &NEXT, &ONE, x, &NEXT);
    blas.dtrsv("L", "T", "N", &w, M, &row, x, &NEXT);
}

// R x + S y = d: w rows of n columns, with the stride of the matrix that they lie in.
struct Conditional {
    double* rows;
    const double* d;
    int row, n, w;
};

inline void substitute(const Blas& blas, const Conditional& of, double* y, double* x) {
    std::copy(of.d, of.d + of.w, x);
    substitute(blas, of.rows, of.row, of.n, of.w, y, x);
}

// Y of Rᵀ Y = Y as it was, of m columns, and B − Sᵀ Y in the place of B.
inline void forward(const Blas& blas, const Conditional& of, double* Y, double* B, int m) {
    int w = of.w, rest = of.n - of.w, row = of.row;
    if (w == 0 || m == 0) return;
    blas.dtrsm("R", "L", "T", "N", &m, &w, &ONE, of.rows, &row, Y, &m);
    if (rest > 0) blas.dgemm("N", "T", &m, &rest, &w, &MINUS_ONE, Y, &m, of.rows + w, &row, &ONE, B, &m);
}

// Blocks (frames, rows, columns) from a first frame on, of which the first element stands at `row` and `column` of a matrix.
struct Piece {
    const double* data;
    int64_t step, row_step, column_step, rows, columns, row, column, first, frames;
};

// A chain of frames of w columns, each of which sees `ahead` columns of those after it, and n − w − ahead shared ones.
struct EliminatedChain {
    int64_t frames;
    int w, ahead, n;
    double *rows, *d;  // (T, w, n) R and S; (T, w)
};

// M (n − w, n − w) and v (n − w), all zero, hold in the end what all frames say of the shared columns behind `ahead`.
inline bool eliminate_chain(const Blas& blas, const std::vector<Piece>& pieces, const double* gradient,
                            const double* damping, double* M, double* v, const EliminatedChain& into) {
    const int64_t n = into.n, w = into.w, ahead = into.ahead, seen = w + ahead, rest = n - w;
    const int64_t met = std::min(w, ahead), kept = ahead - met;  // of what is ahead: in the next frame, and behind it
    int64_t width = seen;  // behind it stand columns that no frame has met so far
    std::vector<double> vector(n);
    for (int64_t t = 0; t < into.frames; t++) {
        double* rows = into.rows + t * w * n;
        for (int64_t r = 0; r < w; r++) {
            double *to = rows + r * n, *from = M + r * rest;
            std::fill(to + (r < met ? ahead : r), to + (r < met ? seen : n), 0.0);
            if (r >= met) continue;
            std::copy(from + r, from + ahead, to + r);
            std::copy(from + ahead, from + rest, to + seen);
        }
        for (int64_t r = 0; r < ahead; r++) {  // the frames move on by one
            double *to = M + r * rest, *from = M + (met + r) * rest;
            std::fill(to + std::max(r, kept), to + (r < kept ? ahead : rest), 0.0);
            if (r >= kept) continue;
            std::copy(from + met + r, from + ahead, to + r);
            std::copy(from + ahead, from + rest, to + ahead);
        }
        for (const Piece& one : pieces) {
            if (t < one.first || t >= one.first + one.frames) continue;
            width = std::max(width, one.column + one.columns);
            for (int64_t r = 0; r < one.rows; r++) {
                const double* from = one.data + (t - one.first) * one.step + r * one.row_step;
                double* to = rows + (one.row + r) * n + one.column;
                const int64_t first = std::max<int64_t>(0, one.row + r - one.column), columns = one.columns, step = one.column_step;
                if (step == 1)  // which the compiler makes quick
                    for (int64_t c = first; c < columns; c++) to[c] += from[c];
                else
                    for (int64_t c = first; c < columns; c++) to[c] += from[c * step];
            }
        }
        std::fill(vector.begin(), vector.end(), 0.0);
        std::copy(v, v + ahead, vector.begin());
        std::copy(v + ahead, v + rest, vector.begin() + seen);
        for (int64_t r = 0; r < w; r++) rows[r * (n + 1)] += damping[r], vector[r] -= gradient[t * w + r];
        if (!eliminate(blas, rows, vector.data(), into.n, static_cast<int>(width), into.w, M, static_cast<int>(rest))) return false;
        std::copy(vector.begin(), vector.begin() + w, into.d + t * w);
        std::copy(vector.begin() + w, vector.end(), v);
    }
    return true;
}

// The steps, in the place of d, of the values behind the last frame: of the frames ahead of it, and of shared columns.
inline void substitute_chain(const Blas& blas, const double* behind, const EliminatedChain& chain) {
    const int64_t n = chain.n, w = chain.w, ahead = chain.ahead;
    std::vector<double> later(behind, behind + n - w);
    for (int64_t t = chain.frames - 1; t >= 0; t--) {
        double* x = chain.d + t * w;
        substitute(blas, chain.rows + t * w * n, chain.n, chain.n, chain.w, later.data(), x);
        std::copy_backward(later.data(), later.data() + std::max<int64_t>(ahead - w, 0), later.data() + ahead);
        std::copy(x, x + std::min(w, ahead), later.data());
    }
}

// Adds what lies on and above the diagonal of k columns to those at ascending places of another matrix.
inline void add_upper(const double* from, int64_t row, int64_t k, const int64_t* places, double* M, int64_t n) {
    for (int64_t first = 0, end; first < k; first = end) {  // in runs of columns that stay beside each other
        for (end = first + 1; end < k && places[end] == places[end - 1] + 1; end++) {}
        for (int64_t i = 0; i < end; i++) {
            const int64_t j = std::max(i, first);
            const double* source = from + i * row + j;
            double* into = M + places[i] * n + places[j];
            for (int64_t c = 0; c < end - j; c++) into[c] += source[c];
        }
    }
}

}  // namespace vip
