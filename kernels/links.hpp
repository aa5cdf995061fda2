// Cost of the bend between two linked sensors; the equations are those of vip_factors/initialise/sensor_tree.py.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "slices.hpp"

namespace vip {

constexpr double PI = 3.14159265358979323846, FREEDOM = 4.0, LIMIT_SIGMA = PI / 18;  // from sensor_tree.py

// Unit quaternions, scalar part first.
inline void quaternion_product(const double* a, const double* b, double* product) {
    product[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    product[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    product[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    product[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

// θ / sin(θ/2) of a rotation by θ, given c = cos(θ/2) in 0 … 1: a polynomial in 2 c − 1 through Chebyshev nodes, accurate to
// 1e-12.
struct AngleOverSine {
    static constexpr int terms = 17;
    double weight[terms]{};
    AngleOverSine() {
        double at[terms], newton[terms];
        for (int k = 0; k < terms; k++) {
            at[k] = std::cos(PI * (k + 0.5) / terms);
            const double c = 0.5 * (at[k] + 1);
            newton[k] = 2 * std::acos(c) / std::sqrt(1 - c * c);
        }
        for (int j = 1; j < terms; j++)
            for (int k = terms - 1; k >= j; k--) newton[k] = (newton[k] - newton[k - 1]) / (at[k] - at[k - j]);
        for (int k = terms - 1; k >= 0; k--) {
            for (int j = terms - 1; j > 0; j--) weight[j] = weight[j - 1] - at[k] * weight[j];
            weight[0] = newton[k] - at[k] * weight[0];
        }
    }
};

// One end of a link, as quaternions: headings (K, 4), mountings (K, M, 4), orientations (T, 4).
struct LinkEnd {
    const double *heading, *mounting, *orientation;
    int64_t headings, mountings;
    int64_t size() const { return headings * mountings; }
    // Quaternions (4, K * M) of the bone in frame t for all headings and mountings.
    void bones(int64_t t, double* bone_components) const {
        for (int64_t k = 0; k < headings; k++) {
            double sensor[4], bone[4];
            quaternion_product(heading + 4 * k, orientation + 4 * t, sensor);
            for (int64_t m = k * mountings; m < (k + 1) * mountings; m++) {
                const double* q = mounting + 4 * m;
                const double inverse[4] = {q[0], -q[1], -q[2], -q[3]};
                quaternion_product(sensor, inverse, bone);
                for (int c = 0; c < 4; c++) bone_components[c * size() + m] = bone[c];
            }
        }
    }
};

// Mean cost (N, M) over T frames of a joint's bend, given the mean, lower and upper limits (3, 3) and the whitening of bends.
VIP_WIDE inline void bend_cost(const LinkEnd& parent, const LinkEnd& child, int64_t T, const double* limits, const double* W, double* cost) {
    static const AngleOverSine series;
    constexpr int batch = 16;  // frames: their product is far from overflow and needs one logarithm
    const int64_t N = parent.size(), M = child.size();
    std::vector<double> above(4 * N), below(4 * M), turn(4 * M), along(M), product(N * M, 1.0);
    std::fill(cost, cost + N * M, 0.0);
    const double *mean = limits, *lower = limits + 3, *upper = limits + 6;
    for (int64_t t = 0; t < T; t++) {
        parent.bones(t, above.data()), child.bones(t, below.data());
        const double *__restrict__ w = below.data(), *__restrict__ x = w + M, *__restrict__ y = x + M, *__restrict__ z = y + M;
        double *__restrict__ cosine = turn.data(), *__restrict__ i = cosine + M, *__restrict__ j = i + M, *__restrict__ k = j + M, *__restrict__ scale = along.data();
        for (int64_t n = 0; n < N; n++) {
            const double a = above[n], b = -above[N + n], c = -above[2 * N + n], d = -above[3 * N + n];
            double* __restrict__ into = product.data() + n * M;
            for (int64_t m = 0; m < M; m++) {
                cosine[m] = a * w[m] - b * x[m] - c * y[m] - d * z[m];
                i[m] = a * x[m] + b * w[m] + c * z[m] - d * y[m];
                j[m] = a * y[m] - b * z[m] + c * w[m] + d * x[m];
                k[m] = a * z[m] + b * y[m] - c * x[m] + d * w[m];
            }
            for (int64_t m = 0; m < M; m++) {
                const double u = 2 * std::abs(cosine[m]) - 1;
                double value = series.weight[AngleOverSine::terms - 1];
#pragma GCC unroll 16
                for (int term = AngleOverSine::terms - 2; term >= 0; term--) value = value * u + series.weight[term];
                scale[m] = std::copysign(value, cosine[m]);
            }
            for (int64_t m = 0; m < M; m++) {
                const double bend[3] = {scale[m] * i[m], scale[m] * j[m], scale[m] * k[m]};
                double off[3], square = 0;
                for (int e = 0; e < 3; e++) {
                    off[e] = bend[e] - mean[e];
                    const double over = bend[e] - upper[e], under = lower[e] - bend[e];
                    const double above_it = over + std::abs(over), below_it = under + std::abs(under);  // twice the excess, or zero
                    square += (above_it * above_it + below_it * below_it) / (4 * LIMIT_SIGMA * LIMIT_SIGMA);
                }
                const double white[3] = {W[0] * off[0] + W[1] * off[1] + W[2] * off[2], W[4] * off[1] + W[5] * off[2], W[8] * off[2]};
                into[m] *= (square + white[0] * white[0] + white[1] * white[1] + white[2] * white[2]) / FREEDOM + 1.0;
            }
        }
        if (t % batch == batch - 1 || t == T - 1)
            for (int64_t i = 0; i < N * M; i++) cost[i] += (FREEDOM + 3) / 2 / T * std::log(product[i]), product[i] = 1.0;
    }
}

}  // namespace vip
