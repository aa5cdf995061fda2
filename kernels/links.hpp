// What two linked sensors say of one another: initialise/sensor_tree.py, whose equations these are.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "slices.hpp"

namespace vip {

constexpr double PI = 3.14159265358979323846, FREEDOM = 4.0, LIMIT_SIGMA = PI / 18;  // as there

// Unit quaternions, scalar part first.
inline void quaternion_product(const double* a, const double* b, double* found) {
    found[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    found[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    found[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    found[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

// Of a rotation its angle over the sine of half of it, from the cosine c of that, 0 to 1: a polynomial in 2 c - 1 through
// Chebyshev's points, good to 1e-12.
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

// Headings (K, 4) as quaternions about the vertical, mountings (K, M, 4), orientations (T, 4): one end of a link.
struct LinkEnd {
    const double *about, *mounting, *turned;
    int64_t headings, mountings;
    int64_t size() const { return headings * mountings; }
    // Quaternions of the bone in frame t, component by component (4, K * M).
    void bones(int64_t t, double* found) const {
        for (int64_t k = 0; k < headings; k++) {
            double sensor[4], bone[4];
            quaternion_product(about + 4 * k, turned + 4 * t, sensor);
            for (int64_t m = k * mountings; m < (k + 1) * mountings; m++) {
                const double* own = mounting + 4 * m;
                const double inverse[4] = {own[0], -own[1], -own[2], -own[3]};
                quaternion_product(sensor, inverse, bone);
                for (int c = 0; c < 4; c++) found[c * size() + m] = bone[c];
            }
        }
    }
};

// Mean cost over T frames of how the joint bends, (N, M), given the bend's mean, lower and upper limits, and whitening.
VIP_WIDE inline void bend_cost(const LinkEnd& parent, const LinkEnd& child, int64_t T, const double* limits, const double* W, double* found) {
    static const AngleOverSine series;
    constexpr int together = 16;  // frames: a product of so many is far from overflow, and one logarithm is enough
    const int64_t N = parent.size(), M = child.size();
    std::vector<double> above(4 * N), below(4 * M), turn(4 * M), along(M), product(N * M, 1.0);
    std::fill(found, found + N * M, 0.0);
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
                    const double above_it = over + std::abs(over), below_it = under + std::abs(under);  // twice, or nought
                    square += (above_it * above_it + below_it * below_it) / (4 * LIMIT_SIGMA * LIMIT_SIGMA);
                }
                const double white[3] = {W[0] * off[0] + W[1] * off[1] + W[2] * off[2], W[4] * off[1] + W[5] * off[2], W[8] * off[2]};
                into[m] *= (square + white[0] * white[0] + white[1] * white[1] + white[2] * white[2]) / FREEDOM + 1.0;
            }
        }
        if (t % together == together - 1 || t == T - 1)
            for (int64_t i = 0; i < N * M; i++) found[i] += (FREEDOM + 3) / 2 / T * std::log(product[i]), product[i] = 1.0;
    }
}

// As in initialise/sensor_faults.py.
constexpr double ARM_SIGMA = 0.2, MISFIT = 1.5, STRONG_SQUARE = 225.0, LEAST_SCALE = 0.05;
constexpr int STARTS = 12, ROUNDS = 12;

// Products of what two sensors say of a joint's acceleration, columns a (3, 4) and b (3, 4), as joint_products of
// initialise/sensor_tree.py sums them over frames (5, 4, 4).
struct JointProducts {
    static constexpr int block = 16, size = 5 * block;
    static void of(const double* a, const double* b, double* into) {
        for (int k = 0; k < 4; k++)
            for (int m = 0; m < 4; m++, into++) {
                into[0] = a[k] * a[m] + a[4 + k] * a[4 + m] + a[8 + k] * a[8 + m];
                into[block] = b[k] * b[m] + b[4 + k] * b[4 + m] + b[8 + k] * b[8 + m];
                into[2 * block] = a[k] * b[m] + a[4 + k] * b[4 + m];
                into[3 * block] = a[4 + k] * b[m] - a[k] * b[4 + m];
                into[4 * block] = a[8 + k] * b[8 + m];
            }
    }
    // Products (8, 8) of the columns of misfits, a and −R b, with the heading's cosine and sine; of a with ∂R b (4, 4).
    static void gram(const double* sums, double cosine, double sine, double* G, double* slope) {
        for (int k = 0; k < 4; k++)
            for (int m = 0; m < 4; m++, sums++) {
                G[8 * k + m] = sums[0], G[8 * (4 + k) + 4 + m] = sums[block];
                G[8 * k + 4 + m] = G[8 * (4 + m) + k] = -(cosine * sums[2 * block] + sine * sums[3 * block] + sums[4 * block]);
                slope[4 * k + m] = cosine * sums[3 * block] - sine * sums[2 * block];
            }
    }
};

// x of A x = b, symmetric positive (n, n); both are spent.
template <int n> inline void solve_positive(double* A, double* b) {
    for (int k = 0; k < n; k++)
        for (int i = k + 1; i < n; i++) {
            const double share = A[n * k + i] / A[n * k + k];
            for (int j = i; j < n; j++) A[n * i + j] -= share * A[n * k + j];
            b[i] -= share * b[k];
        }
    for (int k = n - 1; k >= 0; k--) {
        for (int j = k + 1; j < n; j++) b[k] -= A[n * k + j] * b[j];
        b[k] /= A[n * k + k];
    }
}

inline double median(std::vector<double>& values) {  // in another order after that
    const auto middle = values.begin() + values.size() / 2;
    std::nth_element(values.begin(), middle, values.end());
    return values.size() % 2 ? *middle : (*middle + *std::max_element(values.begin(), middle)) / 2;
}

inline int arm(int i) { return i < 3 ? 1 + i : 2 + i; }  // columns 0 and 4 are what both accelerations are

// Least misfit over headings, given sums of products, and that heading; arms are eliminated.
inline double least_over_headings(const double* sums, double* heading) {
    double least = INFINITY;
    for (int h = 0; h < STARTS; h++) {
        const double angle = 2 * PI * h / STARTS;
        double G[64], slope[16], A[36], linear[6], arms[6];
        JointProducts::gram(sums, std::cos(angle), std::sin(angle), G, slope);
        double cost = G[0] + 2 * G[4] + G[36];
        for (int i = 0; i < 6; i++) {
            linear[i] = arms[i] = G[8 * arm(i)] + G[8 * arm(i) + 4];
            for (int j = 0; j < 6; j++) A[6 * i + j] = G[8 * arm(i) + arm(j)];
            A[7 * i] += MISFIT * MISFIT / (ARM_SIGMA * ARM_SIGMA);
        }
        solve_positive<6>(A, arms);
        for (int i = 0; i < 6; i++) cost -= linear[i] * arms[i];
        if (cost < least) least = cost, *heading = angle;
    }
    return least;
}

// Share, in squares, of a joint's acceleration by which two sensors (T, 3, 4) disagree.
VIP_WIDE inline double joint_share(const double* above, const double* below, int64_t T) {
    constexpr int size = JointProducts::size;
    std::vector<double> products(size * T), square(T), weight(T), sorted(T), across(4 * T);
    double sums[size], G[64], slope[16], unknown[7], A[49], heading = 0;
    const auto weighted_sums = [&] {
        std::fill(sums, sums + size, 0.0);
        for (int64_t t = 0; t < T; t++)
            for (int p = 0; p < size; p++) sums[p] += weight[t] * products[size * t + p];
    };
    for (int64_t t = 0; t < T; t++) {
        double* own = &products[size * t];
        JointProducts::of(above + 12 * t, below + 12 * t, own);
        weight[t] = 1 / (1 + (own[0] + own[JointProducts::block]) / STRONG_SQUARE);
    }
    weighted_sums();
    least_over_headings(sums, &heading);
    double x[8] = {1, 0, 0, 0, 1, 0, 0, 0}, misfit = 0;
    for (int round = 0; round < ROUNDS; round++) {
        const double cosine = std::cos(heading), sine = std::sin(heading);
        for (int64_t t = 0; t < T; t++) {
            double a[3], b[3];
            for (int i = 0; i < 3; i++) {
                const double *one = above + 12 * t + 4 * i, *other = below + 12 * t + 4 * i;
                a[i] = one[0] + one[1] * x[1] + one[2] * x[2] + one[3] * x[3];
                b[i] = other[0] + other[1] * x[5] + other[2] * x[6] + other[3] * x[7];
            }
            const double off[3] = {a[0] - cosine * b[0] + sine * b[1], a[1] - sine * b[0] - cosine * b[1], a[2] - b[2]};
            sorted[t] = square[t] = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];
            across[4 * t] = b[0] * b[0] + b[1] * b[1];  // of the misfit's slope by the heading with itself, and with −R b
            for (int k = 1; k < 4; k++) across[4 * t + k] = b[0] * below[12 * t + 4 + k] - b[1] * below[12 * t + k];
        }
        const double scale = std::max(median(sorted) / 2.37, LEAST_SCALE);
        double turned[4] = {0, 0, 0, 0};
        misfit = 0;
        for (int64_t t = 0; t < T; t++) {
            weight[t] = 1 / (1 + square[t] / (4 * scale)), misfit += weight[t] * square[t];
            for (int k = 0; k < 4; k++) turned[k] += weight[t] * across[4 * t + k];
        }
        weighted_sums();
        JointProducts::gram(sums, cosine, sine, G, slope);
        A[0] = turned[0] + 1e-9, unknown[0] = 0;
        for (int i = 0; i < 6; i++) {
            const double* row = G + 8 * arm(i);
            A[1 + i] = A[7 * (1 + i)] = i < 3 ? 0.0 : turned[i - 2];
            unknown[1 + i] = 0;
            for (int c = 0; c < 8; c++) unknown[1 + i] -= row[c] * x[c];
            unknown[1 + i] -= scale / (ARM_SIGMA * ARM_SIGMA) * x[arm(i)];
            for (int j = 0; j < 6; j++) A[7 * (1 + i) + 1 + j] = row[arm(j)];
            A[8 * (1 + i)] += scale / (ARM_SIGMA * ARM_SIGMA) + 1e-9;
        }
        for (int k = 0; k < 4; k++)
            for (int m = 0; m < 4; m++) {
                unknown[0] += x[k] * slope[4 * k + m] * x[4 + m];
                if (k) A[k] = A[7 * k] -= slope[4 * k + m] * x[4 + m];
            }
        solve_positive<7>(A, unknown);
        heading += unknown[0];
        for (int i = 0; i < 6; i++) x[arm(i)] += unknown[1 + i];
    }
    double joint = 0;
    for (int k = 0; k < 4; k++)
        for (int m = 0; m < 4; m++) joint += x[k] * G[8 * k + m] * x[m];
    return misfit / joint;
}

// How late the one below is, how surely, and the share, as joint_share has it: Gauss–Newton from a delay and a heading.
// Below are coefficients of a cubic spline over instants `step` apart; of each of the T instants above, how many of these
// lie before it, and the number of the block whose misfits belong together.
struct JointDelay { double seconds, sigma, share; };

VIP_WIDE inline JointDelay joint_delay(const double* above, const double* below, const double* place, const int64_t* block,
                                       int64_t T, double step, double reach, double seconds, double heading) {
    std::vector<double> slopes(24 * T), off(3 * T), square(T), sorted(T), weight(T);
    double x[8] = {0, 0, 0, 0, 0, 0, 0, 0}, H[64], misfit = 0;  // the arms from the third on
    for (int round = 0; round < ROUNDS; round++) {
        const double cosine = std::cos(heading), sine = std::sin(heading);
        for (int64_t t = 0; t < T; t++) {
            const double at = place[t] + seconds / step, whole = std::floor(at), f = at - whole, g = 1 - f;
            const double value[4] = {g * g * g / 6, (3 * f * f * f - 6 * f * f + 4) / 6, (3 * g * g * g - 6 * g * g + 4) / 6, f * f * f / 6};
            const double rate[4] = {-g * g / 2, (3 * f * f - 4 * f) / 2, -(3 * g * g - 4 * g) / 2, f * f / 2};
            const double *from = below + 12 * (static_cast<int64_t>(whole) - 1), *a = above + 12 * t;
            double b[12], moved[12], turned[12], *S = &slopes[24 * t];
            for (int c = 0; c < 12; c++) {
                b[c] = value[0] * from[c] + value[1] * from[12 + c] + value[2] * from[24 + c] + value[3] * from[36 + c];
                moved[c] = (rate[0] * from[c] + rate[1] * from[12 + c] + rate[2] * from[24 + c] + rate[3] * from[36 + c]) / step;
            }
            double point[3], speed[3];
            for (int c = 0; c < 4; c++) {
                turned[c] = cosine * b[c] - sine * b[4 + c], turned[4 + c] = sine * b[c] + cosine * b[4 + c];
                turned[8 + c] = b[8 + c];
            }
            for (int i = 0; i < 3; i++) {
                point[i] = turned[4 * i], speed[i] = moved[4 * i];
                double own = a[4 * i];
                for (int c = 1; c < 4; c++) {
                    own += a[4 * i + c] * x[1 + c], point[i] += turned[4 * i + c] * x[4 + c], speed[i] += moved[4 * i + c] * x[4 + c];
                    S[8 * i + 1 + c] = a[4 * i + c], S[8 * i + 4 + c] = -turned[4 * i + c];
                }
                off[3 * t + i] = own - point[i];
            }
            S[0] = -(cosine * speed[0] - sine * speed[1]), S[8] = -(sine * speed[0] + cosine * speed[1]), S[16] = -speed[2];
            S[1] = point[1], S[9] = -point[0], S[17] = 0;
            sorted[t] = square[t] = off[3 * t] * off[3 * t] + off[3 * t + 1] * off[3 * t + 1] + off[3 * t + 2] * off[3 * t + 2];
        }
        const double scale = std::max(median(sorted) / 2.37, LEAST_SCALE), prior = scale / (ARM_SIGMA * ARM_SIGMA);
        double sums[8] = {0, 0, 0, 0, 0, 0, 0, 0}, A[64];
        std::fill(H, H + 64, 0.0), misfit = 0;
        for (int64_t t = 0; t < T; t++) {
            weight[t] = 1 / (1 + square[t] / (4 * scale)), misfit += weight[t] * square[t];
            for (int i = 0; i < 3; i++) {
                const double* S = &slopes[24 * t + 8 * i];
                for (int r = 0; r < 8; r++) {
                    const double w = weight[t] * S[r];
                    sums[r] -= w * off[3 * t + i];
                    for (int c = 0; c < 8; c++) H[8 * r + c] += w * S[c];
                }
            }
        }
        for (int r = 0; r < 8; r++) {
            H[9 * r] += 1e-9 + (r > 1 ? prior : 0.0);
            if (r > 1) sums[r] -= prior * x[r];
        }
        std::copy(H, H + 64, A);
        solve_positive<8>(A, sums);
        seconds += std::clamp(sums[0], -0.03, 0.03), heading += sums[1];
        for (int r = 2; r < 8; r++) x[r] += sums[r];
        if (std::abs(seconds) > reach) break;
    }
    double z[8] = {1, 0, 0, 0, 0, 0, 0, 0}, joint = 0, spread = 0, sum = 0;
    solve_positive<8>(H, z);
    for (int64_t t = 0; t < T; t++) {
        if (t && block[t] != block[t - 1]) spread += sum * sum, sum = 0;
        for (int i = 0; i < 3; i++) {
            const double *S = &slopes[24 * t + 8 * i], *a = above + 12 * t + 4 * i;
            double along = 0;
            for (int r = 0; r < 8; r++) along += z[r] * S[r];
            sum += weight[t] * along * off[3 * t + i];
            const double own = a[0] + a[1] * x[2] + a[2] * x[3] + a[3] * x[4];
            joint += weight[t] * own * own;
        }
    }
    return {seconds, std::sqrt(spread + sum * sum), misfit / joint};
}

}  // namespace vip
