// Coordinates x of joints 1 … 23, all of them together: Dᵀ P E between frames, of block-diagonal D and E.
//
// P and P E are kept with the columns of all joints' first, second and third coordinates apart: what a joint is
// multiplied with then stands beside what the next one is.
#pragma once
#include "slices.hpp"

namespace vip {

constexpr int LIMBS = JOINTS - 1, POSE = 3 * LIMBS;
using Apart = double[POSE][3][JOINTS];  // (69, 69), a column of noughts behind each third

// By joints' coordinates, (23, 3, 3), of one frame of the slice.
struct OfJoints {
    int frame;
    double D[9 * LIMBS];
    Apart PD;
};

class JointSums {
  public:
    JointSums(BodySums& sums, const double* P) : sums_(sums), P_(P) {
        for (int r = 0; r < POSE; r++)
            for (int b = 0; b < LIMBS; b++)
                for (int l = 0; l < 3; l++) apart_[r][l][b] = P[r * POSE + 3 * b + l];
    }

    // How coordinates change with the rotation of each joint, in frame f: of the slice's, or `ahead` of it.
    void set(OfJoints& into, int64_t f, int ahead, const double* D) const {
        into.frame = ahead;
        std::copy(D, D + 9 * LIMBS, into.D);
        const double* turns = sums_.bones().turns;
        for (int b = 0; b < LIMBS && turns != nullptr; b++) product<3, 3, 3>(D + 9 * b, turns + 9 * (JOINTS * f + b + 1), into.D + 9 * b);
        times(into);
    }

    // weight · ½ xᵀ P x, of coordinates that move with one frame's joints or with two's.
    VIP_WIDE void add(int64_t t, const OfJoints* of, int frames, const double* x, double weight, int64_t mean) const {
        double force[POSE];
        for (int r = 0; r < POSE; r++) {
            double sum = 0;
            for (int c = 0; c < POSE; c++) sum += P_[r * POSE + c] * x[c];
            force[r] = weight * sum;
        }
        for (int i = 0; i < frames; i++) {
            for (int a = 0; a < POSE; a++) {
                const double* D = of[i].D + 9 * (a / 3) + a % 3;
                sums_.target().gradient(t, sums_.column(of[i].frame, 3 + a)) +=
                    D[0] * force[a / 3 * 3] + D[3] * force[a / 3 * 3 + 1] + D[6] * force[a / 3 * 3 + 2];
            }
            for (int j = i; j < frames; j++) between(t, of[i], of[j], weight);
        }
        if (mean < 0) return;
        const Target& target = sums_.target();  // the mean moves against the coordinates
        for (int a = 0; a < POSE; a++) {
            const int64_t own = sums_.column(of[0].frame, 3 + a);
            double *into = target.row(t, own) + target.place(own, mean), *mean_row = target.row(t, mean + a) + target.place(mean + a, mean);
            for (int k = 0; k < 3; k++) {
                const double s = weight * of[0].D[9 * (a / 3) + 3 * k + a % 3], *row = P_ + (a / 3 * 3 + k) * POSE;
                for (int c = 0; c < POSE; c++) into[c] -= s * row[c];
            }
            for (int c = a; c < POSE; c++) mean_row[c] += weight * P_[a * POSE + c];
            target.gradient(t, mean + a) -= force[a];
        }
    }

  private:
    BodySums& sums_;
    const double* P_;
    Apart apart_ = {};

    VIP_WIDE void times(OfJoints& into) const {
        double E[3][3][JOINTS] = {};
        for (int b = 0; b < LIMBS; b++)
            for (int e = 0; e < 9; e++) E[e / 3][e % 3][b] = into.D[9 * b + e];
        for (int r = 0; r < POSE; r++)
            for (int c = 0; c < 3; c++)
                for (int b = 0; b < JOINTS; b++)
                    into.PD[r][c][b] = apart_[r][0][b] * E[0][c][b] + apart_[r][1][b] * E[1][c][b] + apart_[r][2][b] * E[2][c][b];
    }

    VIP_WIDE void between(int64_t t, const OfJoints& one, const OfJoints& other, double weight) const {
        const int64_t width = sums_.row_width(one.frame);
        double *joints = sums_.block_of(t, one.frame, other.frame) + 3 * width + 3, row[3][JOINTS];
        for (int a = 0; a < LIMBS; a++)
            for (int r = 0; r < 3; r++) {
                const double s[3] = {weight * one.D[9 * a + r], weight * one.D[9 * a + 3 + r], weight * one.D[9 * a + 6 + r]};
                for (int c = 0; c < 3; c++)
                    for (int b = 0; b < JOINTS; b++)
                        row[c][b] = s[0] * other.PD[3 * a][c][b] + s[1] * other.PD[3 * a + 1][c][b] + s[2] * other.PD[3 * a + 2][c][b];
                double* into = joints + (3 * a + r) * width;
                for (int b = one.frame == other.frame ? a : 0; b < LIMBS; b++)
                    into[3 * b] += row[0][b], into[3 * b + 1] += row[1][b], into[3 * b + 2] += row[2][b];
            }
    }
};

}  // namespace vip
