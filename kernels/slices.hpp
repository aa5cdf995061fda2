// Equations of terms summed into slices: vip_factors/assembly/accumulator.py and bone_blocks.py, factor by factor.
//
// A row of a factor has columns by the twists of one bone, in one to three frames, and columns of the slice. Products
// of the first are summed bone by bone, carried down the skeleton, and meet the screws of the joints last (composite
// inertias); products of the second go where they belong. Only what lies on and above the diagonal is written.
#pragma once
#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "rotations.hpp"

#if defined(__linux__) && defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define VIP_WIDE __attribute__((target_clones("default", "avx2,fma")))  // chosen by the processor that it runs on
#else
#define VIP_WIDE
#endif

namespace vip {

constexpr int JOINTS = 24, TWIST = 6, FRAMES = 3, SCREWS = JOINTS + 1, BODY = 3 * SCREWS, POSE = 3 * (JOINTS - 1);
constexpr int PAIRS = 6;  // of frames i ≤ j of a slice

inline int pair_of(int i, int j) { return i * FRAMES - i * (i - 1) / 2 + j - i; }

struct Slices {  // (frames, width, width) and (frames, width)
    double *hessian, *gradient;
    int64_t frames, width;
    double* row(int64_t t, int64_t column) const { return hessian + (t * width + column) * width; }
    void add(int64_t t, int64_t one, int64_t other, double value) const {
        row(t, std::min(one, other))[std::max(one, other)] += value;
    }
};

// The rows of one factor: `groups` times `k` columns by a bone's twist, then `direct` ones of the slice.
struct Rows {
    int m, groups, k, direct;
    const double* J;  // (m, groups · k + direct)
    const double* residual;  // (m)
    const int64_t* columns;  // (direct)
    double weight;
};

class BodySums {
  public:
    // first: column of the body in a frame; frame: width of one; parents: of the joints, before them
    BodySums(Slices slices, int64_t first, int64_t frame, const int64_t* parents, int64_t others)
        : slices_(slices), first_(first), frame_(frame), parents_(parents, parents + JOINTS), others_(others),
          place_(slices.width, -1), information_(slices.frames * PAIRS * JOINTS * TWIST * TWIST),
          force_(slices.frames * FRAMES * JOINTS * TWIST), coupling_(slices.frames * FRAMES * JOINTS * TWIST * others) {}

    VIP_WIDE void add(int64_t t, int64_t bone, const Rows& rows) {
        const int width = rows.groups * rows.k + rows.direct;
        for (int g = 0; g < rows.groups; g++) {
            for (int h = g; h < rows.groups; h++) {
                double* into = information(t, pair_of(g, h), bone);
                met_[pair_of(g, h)] = true;
                for (int a = 0; a < rows.k; a++)
                    for (int b = 0; b < rows.k; b++)
                        into[a * TWIST + b] += rows.weight * dot(rows, g * rows.k + a, h * rows.k + b, width);
            }
            for (int a = 0; a < rows.k; a++) {
                double sum = 0;
                for (int r = 0; r < rows.m; r++) sum += rows.J[r * width + g * rows.k + a] * rows.residual[r];
                force(t, g, bone)[a] += rows.weight * sum;
                double* into = coupling(t, g, bone) + a * others_;
                for (int d = 0; d < rows.direct; d++)
                    into[place(rows.columns[d])] +=
                        rows.weight * dot(rows, g * rows.k + a, rows.groups * rows.k + d, width);
            }
        }
        add_direct(slices_, t, rows);
    }

    // What no bone has to do with.
    VIP_WIDE static void add_direct(const Slices& slices, int64_t t, const Rows& rows) {
        const int start = rows.groups * rows.k, width = start + rows.direct;
        for (int a = 0; a < rows.direct; a++) {
            double sum = 0;
            for (int r = 0; r < rows.m; r++) sum += rows.J[r * width + start + a] * rows.residual[r];
            slices.gradient[t * slices.width + rows.columns[a]] += rows.weight * sum;
            for (int b = a; b < rows.direct; b++)
                slices.add(t, rows.columns[a], rows.columns[b], rows.weight * dot(rows, start + a, start + b, width));
        }
    }

    // Carry all over to the joints, by screws (frames, 25, 6, 3).
    void expand(const double* screws) {
        for (int64_t t = 0; t < slices_.frames; t++) {
            for (int i = 0; i < FRAMES && t + i < slices_.frames; i++) {
                const double* now = screws + (t + i) * SCREWS * 18;
                for (int j = i; j < FRAMES && t + j < slices_.frames; j++)
                    if (met_[pair_of(i, j)]) expand_pair(t, i, j, now, screws + (t + j) * SCREWS * 18);
                if (met_[pair_of(i, i)]) expand_others(t, i, now);
            }
        }
    }

    // D_iᵀ P D_j between the joints 1 … 23 of frames, and D_iᵀ of the force; D (23, 3, 3), P (69, 69).
    VIP_WIDE void add_joints(int64_t t, int i, int j, const double* D, const double* E, const double* P, double weight) {
        double half[3 * POSE];
        for (int a = 0; a < JOINTS - 1; a++) {
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < POSE; c++)
                    half[r * POSE + c] = weight * (D[9 * a + r] * P[(3 * a) * POSE + c] +
                                                   D[9 * a + 3 + r] * P[(3 * a + 1) * POSE + c] +
                                                   D[9 * a + 6 + r] * P[(3 * a + 2) * POSE + c]);
            for (int r = 0; r < 3; r++) {
                double* into = slices_.row(t, column(i, 3 + 3 * a + r)) + column(j, 3);
                for (int b = i == j ? a : 0; b < JOINTS - 1; b++)
                    for (int c = 0; c < 3; c++)
                        into[3 * b + c] += half[r * POSE + 3 * b] * E[9 * b + c] +
                                           half[r * POSE + 3 * b + 1] * E[9 * b + 3 + c] +
                                           half[r * POSE + 3 * b + 2] * E[9 * b + 6 + c];
            }
        }
    }

    int64_t column(int frame, int64_t own) const { return frame * frame_ + first_ + own; }
    const Slices& slices() const { return slices_; }

  private:
    Slices slices_;
    int64_t first_, frame_;
    std::vector<int64_t> parents_;
    int64_t others_;
    std::vector<int64_t> place_, columns_;  // of columns of the slice among those that twists meet, and back
    std::vector<double> information_, force_, coupling_;
    bool met_[PAIRS] = {};  // which pairs of frames have anything at all

    static double dot(const Rows& rows, int a, int b, int width) {
        double sum = 0;
        for (int r = 0; r < rows.m; r++) sum += rows.J[r * width + a] * rows.J[r * width + b];
        return sum;
    }
    double* information(int64_t t, int pair, int64_t bone) {
        return &information_[((t * PAIRS + pair) * JOINTS + bone) * TWIST * TWIST];
    }
    double* force(int64_t t, int i, int64_t bone) { return &force_[((t * FRAMES + i) * JOINTS + bone) * TWIST]; }
    double* coupling(int64_t t, int i, int64_t bone) {
        return &coupling_[((t * FRAMES + i) * JOINTS + bone) * TWIST * others_];
    }
    int64_t place(int64_t column) {
        if (place_[column] < 0) {
            if (static_cast<int64_t>(columns_.size()) == others_) throw std::out_of_range("a column too many");
            place_[column] = static_cast<int64_t>(columns_.size());
            columns_.push_back(column);
        }
        return place_[column];
    }

    VIP_WIDE void expand_pair(int64_t t, int i, int j, const double* now, const double* later) {
        double* I = information(t, pair_of(i, j), 0);
        for (int b = JOINTS - 1; b > 0; b--)
            for (int e = 0; e < 36; e++) I[36 * parents_[b] + e] += I[36 * b + e];
        double right[18], left[18], block[9];
        for (int b = 0; b <= JOINTS; b++) {
            const double* own = I + 36 * (b < JOINTS ? b : 0);
            product<6, 6, 3>(own, later + 18 * b, right);
            // Of those that move the bone: itself, its ancestors, the root's translation.
            for (int a = b; a >= 0; a = a < JOINTS ? static_cast<int>(parents_[a]) : -1) {
                transposed_product(now + 18 * a, right, block);
                put(t, i, a, j, b, block);
            }
            if (b == JOINTS) break;
            transposed_product(now + 18 * JOINTS, right, block);
            if (i < j) {
                put(t, i, JOINTS, j, b, block);
                for (int r = 0; r < 3; r++)  // (Sᵀ I) with the later frame's screws
                    for (int c = 0; c < 6; c++) {
                        double sum = 0;
                        for (int e = 0; e < 6; e++) sum += now[18 * b + 3 * e + r] * own[6 * e + c];
                        left[6 * r + c] = sum;
                    }
                for (int a = static_cast<int>(parents_[b]); a >= 0; a = static_cast<int>(parents_[a])) {
                    product<3, 6, 3>(left, later + 18 * a, block);
                    put(t, i, b, j, a, block);
                }
                product<3, 6, 3>(left, later + 18 * JOINTS, block);
                put(t, i, b, j, JOINTS, block);
            } else {  // above the diagonal: the translation is last
                double mirrored[9];
                for (int r = 0; r < 3; r++)
                    for (int c = 0; c < 3; c++) mirrored[3 * r + c] = block[3 * c + r];
                put(t, i, b, j, JOINTS, mirrored);
            }
        }
    }

    VIP_WIDE void expand_others(int64_t t, int i, const double* screws) {
        const int64_t n = others_, used = static_cast<int64_t>(columns_.size());
        for (int b = JOINTS - 1; b > 0; b--) {
            for (int e = 0; e < TWIST; e++) force(t, i, parents_[b])[e] += force(t, i, b)[e];
            double *into = coupling(t, i, parents_[b]), *from = coupling(t, i, b);
            for (int64_t e = 0; e < TWIST * n; e++) into[e] += from[e];
        }
        std::vector<double> sums(used);
        for (int b = 0; b <= JOINTS; b++) {
            const int bone = b < JOINTS ? b : 0;
            const double *S = screws + 18 * b, *f = force(t, i, bone), *C = coupling(t, i, bone);
            for (int c = 0; c < 3; c++) {
                const int64_t own = column(i, 3 * b + c);
                double pulled = 0;
                std::fill(sums.begin(), sums.end(), 0.0);
                for (int e = 0; e < TWIST; e++) {
                    pulled += S[3 * e + c] * f[e];
                    for (int64_t d = 0; d < used; d++) sums[d] += S[3 * e + c] * C[e * n + d];
                }
                slices_.gradient[t * slices_.width + own] += pulled;
                double* into = slices_.row(t, own);
                for (int64_t d = 0; d < used; d++)
                    if (columns_[d] > own) into[columns_[d]] += sums[d];
                    else slices_.add(t, own, columns_[d], sums[d]);
            }
        }
    }

    static void transposed_product(const double* S, const double* right, double* block) {
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) {
                double sum = 0;
                for (int e = 0; e < 6; e++) sum += S[3 * e + r] * right[3 * e + c];
                block[3 * r + c] = sum;
            }
    }
    void put(int64_t t, int i, int a, int j, int b, const double* block) {
        for (int r = 0; r < 3; r++) {
            double* into = slices_.row(t, column(i, 3 * a + r)) + column(j, 3 * b);
            for (int c = 0; c < 3; c++) into[c] += block[3 * r + c];
        }
    }
};

}  // namespace vip
