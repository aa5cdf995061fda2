// Terms on the coordinates x of joints 1 … 23 together: blocks Dᵀ P E between frames with block-diagonal D and E.
//
// P and P E are stored by first, second and third coordinates of all joints, so that operands of neighbouring joints are
// adjacent.
#pragma once
#include "slices.hpp"

namespace vip {

constexpr int LIMBS = JOINTS - 1, POSE = 3 * LIMBS;
using CoordinateMatrix = double[POSE][3][JOINTS];  // (69, 69), columns by coordinate, each padded with a zero

// Derivatives (23, 3, 3) of the coordinates by the joints of one frame of a slice.
struct JointJacobians {
    int frame;
    double D[9 * LIMBS];
    CoordinateMatrix PD;
};

class JointSums {
  public:
    JointSums(BodySums& sums, const double* P) : sums_(sums), P_(P) {
        for (int r = 0; r < POSE; r++)
            for (int b = 0; b < LIMBS; b++)
                for (int l = 0; l < 3; l++) P_by_coordinate_[r][l][b] = P[r * POSE + 3 * b + l];
    }

    // Sets the derivatives by each joint's rotation in frame f, `ahead` frames after the slice's first frame.
    void set(JointJacobians& into, int64_t f, int ahead, const double* D) const {
        into.frame = ahead;
        std::copy(D, D + 9 * LIMBS, into.D);
        const double* turns = sums_.bones().turns;
        for (int b = 0; b < LIMBS && turns != nullptr; b++) product<3, 3, 3>(D + 9 * b, turns + 9 * (JOINTS * f + b + 1), into.D + 9 * b);
        multiply(into);
    }

    // Adds weight · ½ xᵀ P x, where x depends on the joints of one or two frames. `mean` is the first column of the pose mean,
    // which is subtracted in x, or negative.
    VIP_WIDE void add(int64_t t, const JointJacobians* jacobians, int frames, const double* x, double weight, int64_t mean) const {
        double gradient[POSE];
        for (int r = 0; r < POSE; r++) {
            double sum = 0;
            for (int c = 0; c < POSE; c++) sum += P_[r * POSE + c] * x[c];
            gradient[r] = weight * sum;
        }
        for (int i = 0; i < frames; i++) {
            for (int a = 0; a < POSE; a++) {
                const double* D = jacobians[i].D + 9 * (a / 3) + a % 3;
                sums_.target().gradient(t, sums_.column(jacobians[i].frame, 3 + a)) +=
                    D[0] * gradient[a / 3 * 3] + D[3] * gradient[a / 3 * 3 + 1] + D[6] * gradient[a / 3 * 3 + 2];
            }
            for (int j = i; j < frames; j++) add_block(t, jacobians[i], jacobians[j], weight);
        }
        if (mean < 0) return;
        const Target& target = sums_.target();
        for (int a = 0; a < POSE; a++) {
            const int64_t joint = sums_.column(jacobians[0].frame, 3 + a);
            double *into = target.row(t, joint) + target.place(joint, mean), *mean_row = target.row(t, mean + a) + target.place(mean + a, mean);
            for (int k = 0; k < 3; k++) {
                const double s = weight * jacobians[0].D[9 * (a / 3) + 3 * k + a % 3], *row = P_ + (a / 3 * 3 + k) * POSE;
                for (int c = 0; c < POSE; c++) into[c] -= s * row[c];
            }
            for (int c = a; c < POSE; c++) mean_row[c] += weight * P_[a * POSE + c];
            target.gradient(t, mean + a) -= gradient[a];
        }
    }

  private:
    BodySums& sums_;
    const double* P_;
    CoordinateMatrix P_by_coordinate_ = {};

    // PD = P D
    VIP_WIDE void multiply(JointJacobians& into) const {
        double E[3][3][JOINTS] = {};
        for (int b = 0; b < LIMBS; b++)
            for (int e = 0; e < 9; e++) E[e / 3][e % 3][b] = into.D[9 * b + e];
        for (int r = 0; r < POSE; r++)
            for (int c = 0; c < 3; c++)
                for (int b = 0; b < JOINTS; b++)
                    into.PD[r][c][b] = P_by_coordinate_[r][0][b] * E[0][c][b] + P_by_coordinate_[r][1][b] * E[1][c][b] + P_by_coordinate_[r][2][b] * E[2][c][b];
    }

    VIP_WIDE void add_block(int64_t t, const JointJacobians& first, const JointJacobians& second, double weight) const {
        const int64_t width = sums_.row_width(first.frame);
        double *joints = sums_.block_of(t, first.frame, second.frame) + 3 * width + 3, row[3][JOINTS];
        for (int a = 0; a < LIMBS; a++)
            for (int r = 0; r < 3; r++) {
                const double s[3] = {weight * first.D[9 * a + r], weight * first.D[9 * a + 3 + r], weight * first.D[9 * a + 6 + r]};
                for (int c = 0; c < 3; c++)
                    for (int b = 0; b < JOINTS; b++)
                        row[c][b] = s[0] * second.PD[3 * a][c][b] + s[1] * second.PD[3 * a + 1][c][b] + s[2] * second.PD[3 * a + 2][c][b];
                double* into = joints + (3 * a + r) * width;
                for (int b = first.frame == second.frame ? a : 0; b < LIMBS; b++)
                    into[3 * b] += row[0][b], into[3 * b + 1] += row[1][b], into[3 * b + 2] += row[2][b];
            }
    }
};

}  // namespace vip
