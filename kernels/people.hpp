// Everybody in a video frame against every wearer's body: live/association_evidence.py, whose equations these are.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>

namespace vip {

// As there: FITTING_M, LEAST_CONFIDENCE, FULL_CONFIDENCE, CAUCHY, NEAREST_M, FREE_M, LEAST_WEIGHT and TURNS.
constexpr double FITTING = 0.15, LEAST_CONFIDENCE = 0.1, FULL_CONFIDENCE = 0.3, CAUCHY_SQUARE = 4.0, NEAREST = 0.5;
constexpr double FREE_SQUARE = 1e4, LEAST_WEIGHT = 1e-6;
constexpr int TURNS = 3;

// Of K keypoints: which the body has and which are major joints, one or nought, and their precisions.
struct Keypoints {
    int64_t count;
    const double *known, *major, *precision;
};

// xᵀ A⁻¹ x of a symmetric positive (3, 3), by its factors L D Lᵀ.
inline double mahalanobis(const double* A, const double* x) {
    const double l10 = A[3] / A[0], l20 = A[6] / A[0], d1 = A[4] - l10 * A[3];
    const double l21 = (A[7] - l20 * A[3]) / d1, d2 = A[8] - l20 * A[6] - l21 * l21 * d1;
    const double y1 = x[1] - l10 * x[0], y2 = x[2] - l20 * x[0] - l21 * y1;
    return x[0] * x[0] / A[0] + y1 * y1 / d1 + y2 * y2 / d2;
}

// One body's keypoints (K, 3) in the camera's axes against those seen of one person, rays (K, 2) and weights (K):
// shape, fitting, seen, position. The covariance (3, 3) is of where the body is.
inline void fit_person(const Keypoints& of, const double* points, const double* rays, const double* weight,
                       const double* covariance, double depth_share, double side, double* found) {
    double place[3] = {0, 0, 0}, count = 0;
    for (int64_t k = 0; k < of.count; k++) {
        count += of.known[k];
        for (int c = 0; c < 3; c++) place[c] += of.known[k] * points[3 * k + c];
    }
    for (double& one : place) one /= std::max(count, 1.0);
    const double depth = std::max(place[2], NEAREST), own = depth_share * depth * depth_share * depth;
    const double prior = 1 / (own + covariance[8]);
    double t[3], mean[4], total, along, shape, weights, sure, fits;
    for (int turn = 0; turn <= TURNS; turn++) {  // the last has nothing left to solve for
        double sums[6] = {0, 0, 0, 0, 0, 0};
        total = 1 / FREE_SQUARE, shape = weights = sure = fits = 0;
        for (int64_t k = 0; k < of.count; k++) {
            const double w = weight[k] * of.known[k];
            if (w == 0) continue;
            const double u = rays[2 * k], v = rays[2 * k + 1], z = points[3 * k + 2] - place[2];
            const double x = u * z - (points[3 * k] - place[0]), y = v * z - (points[3 * k + 1] - place[1]);
            double each = w * of.precision[k];
            if (turn) {
                const double a = t[0] - u * t[2] - x, b = t[1] - v * t[2] - y, square = a * a + b * b;
                const double doubted = square * (of.precision[k] / CAUCHY_SQUARE);
                if (turn == TURNS) {
                    const double clear = of.major[k] * std::clamp((w - LEAST_CONFIDENCE) / FULL_CONFIDENCE, 0.0, 1.0);
                    shape += w * CAUCHY_SQUARE * std::log1p(doubted), weights += w;
                    sure += clear, fits += clear * std::exp(-0.5 * square / (FITTING * FITTING));
                    continue;
                }
                each /= 1 + doubted;
            }
            const double terms[6] = {u, v, x, y, u * u + v * v, u * x + v * y};
            for (int i = 0; i < 6; i++) sums[i] += each * terms[i];
            total += each;
        }
        if (turn == TURNS) break;
        for (int i = 0; i < 4; i++) mean[i] = sums[i] / total;
        along = sums[4] + prior - mean[0] * sums[0] - mean[1] * sums[1];
        t[2] = std::max((prior * depth + mean[0] * sums[2] + mean[1] * sums[3] - sums[5]) / along, NEAREST);
        for (int c = 0; c < 2; c++) t[c] = mean[2 + c] + mean[c] * t[2];
        if (turn < TURNS - 1) continue;
        const double way[3] = {mean[0], mean[1], 1.0};
        double around[9], moved[3] = {t[0] - place[0], t[1] - place[1], t[2] - depth};
        for (int i = 0; i < 9; i++) around[i] = covariance[i] + way[i / 3] * way[i % 3] / along;
        for (int c = 0; c < 2; c++) around[4 * c] += side * side + 1 / total;
        around[8] += own / 4;
        found[3] = mahalanobis(around, moved);
    }
    found[0] = shape / std::max(weights, LEAST_WEIGHT), found[1] = fits, found[2] = sure;
}

}  // namespace vip
