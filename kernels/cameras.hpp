// Camera pose from a body and its detected keypoints; the equations are those of vip_factors/associate/hypothesis.py.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "rotations.hpp"

namespace vip {

// From hypothesis.py: the square of CAUCHY, a fifth of NEAREST_DEPTH, MAX_TURN.
constexpr double CAUCHY_SQUARE = 4.0, LEAST_DEPTH = 0.1, MAX_TURN = 0.5;

// K points (K, 3) relative to their mean, their image points (K, 2), weights (K), and precisions (K) in units of the loss.
struct Observation {
    int64_t count;
    const double *points, *image, *weight, *precision;
};

// Cost of a camera pose, and its normal equations: the upper triangle of (6, 6), and (6).
struct CameraSums {
    double cost, H[36], g[6];
};

inline void sum_camera(const Observation& observation, const double* R, const double* t, CameraSums& sums) {
    std::fill(sums.H, sums.H + 36, 0.0), std::fill(sums.g, sums.g + 6, 0.0);
    double costs = 0, weights = 0;
    for (int64_t k = 0; k < observation.count; k++) {
        const double w = observation.weight[k];
        if (w == 0) continue;
        double r[3];
        product<3, 3, 1>(R, observation.points + 3 * k, r);
        const double inverse = 1 / std::max(r[2] + t[2], LEAST_DEPTH);
        const double x = (r[0] + t[0]) * inverse, y = (r[1] + t[1]) * inverse;
        const double error[2] = {x - observation.image[2 * k], y - observation.image[2 * k + 1]};
        const double square = (error[0] * error[0] + error[1] * error[1]) * observation.precision[k];
        costs += w * CAUCHY_SQUARE * std::log(1 + square), weights += w;
        const double information = w * CAUCHY_SQUARE * observation.precision[k] / (1 + square) * inverse;
        const double J[2][6] = {{-x * r[1], r[2] + x * r[0], -r[1], 1, 0, -x}, {-r[2] - y * r[1], y * r[0], r[0], 0, 1, -y}};
        for (int row = 0; row < 2; row++)
            for (int i = 0; i < 6; i++) {
                const double scaled = information * J[row][i];
                sums.g[i] += scaled * error[row];
                for (int j = i; j < 6; j++) sums.H[6 * i + j] += scaled * inverse * J[row][j];
            }
    }
    sums.cost = costs / std::max(weights, 1e-9);
}

// x = −(H + damping diag H + 1e-6)⁻¹ g by a UᵀDU factorisation of the upper triangle.
inline void camera_step(const CameraSums& sums, double damping, double* x) {
    double U[36], D[6];
    for (int i = 0; i < 6; i++) {
        D[i] = sums.H[7 * i] * (1 + damping) + 1e-6, x[i] = -sums.g[i];
        for (int l = 0; l < i; l++) D[i] -= U[6 * l + i] * U[6 * l + i] * D[l], x[i] -= U[6 * l + i] * x[l];
        for (int j = i + 1; j < 6; j++) {
            double sum = sums.H[6 * i + j];
            for (int l = 0; l < i; l++) sum -= U[6 * l + i] * D[l] * U[6 * l + j];
            U[6 * i + j] = sum / D[i];
        }
    }
    for (int i = 5; i >= 0; i--) {
        x[i] /= D[i];
        for (int j = i + 1; j < 6; j++) x[i] -= U[6 * i + j] * x[j];
    }
}

// Moves a camera pose R (3, 3), t (3) by some Levenberg–Marquardt steps, in place; returns its cost.
inline double follow_camera(const Observation& observation, int64_t steps, double* R, double* t) {
    CameraSums sums, sums_new;
    double damping = 1e-3, x[6], turn[9], R_new[9], t_new[3];
    sum_camera(observation, R, t, sums);
    for (int64_t step = 0; step < steps; step++) {
        camera_step(sums, damping, x);
        const double scale = std::min(1.0, MAX_TURN / std::max(std::sqrt(square(x)), 1e-12));
        for (double& value : x) value *= scale;
        exp(x, turn), product<3, 3, 3>(turn, R, R_new);
        for (int c = 0; c < 3; c++) t_new[c] = t[c] + x[3 + c];
        t_new[2] = std::min(std::max(t_new[2], t[2] / 2), t[2] * 2);
        sum_camera(observation, R_new, t_new, sums_new);
        const bool is_better = sums_new.cost < sums.cost;
        damping *= is_better ? 0.1 : 30;
        if (!is_better) continue;
        sums = sums_new;
        std::copy(R_new, R_new + 9, R), std::copy(t_new, t_new + 3, t);
    }
    return sums.cost;
}

}  // namespace vip
