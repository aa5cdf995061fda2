// SO(3) for single rotations: the closed forms of vip_factors/geometry/rotations.py; tests compare the two.
#pragma once
#include <algorithm>
#include <cmath>

namespace vip {

constexpr double SMALL_SQUARE = 1e-4;  // square of SMALL_ANGLE in rotations.py

inline double square(const double* v) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; }

// d I + a hat(v) + o v vᵀ
inline void combined(const double* v, double d, double a, double o, double* M) {
    const double x = v[0], y = v[1], z = v[2];
    M[0] = d + o * x * x, M[1] = o * x * y - a * z, M[2] = o * x * z + a * y;
    M[3] = o * x * y + a * z, M[4] = d + o * y * y, M[5] = o * y * z - a * x;
    M[6] = o * x * z - a * y, M[7] = o * y * z + a * x, M[8] = d + o * z * z;
}

struct SineTerms { double a, b, c; };  // sin θ/θ, (1 − cos θ)/θ², (θ − sin θ)/θ³

inline SineTerms sine_terms(double q) {
    if (q < SMALL_SQUARE)
        return {1 + q * (-1. / 6 + q / 120), 0.5 + q * (-1. / 24 + q / 720), 1. / 6 + q * (-1. / 120 + q / 5040)};
    const double angle = std::sqrt(q), sine = std::sin(angle), half = std::sin(angle / 2);
    return {sine / angle, 2 * half * half / q, (angle - sine) / (q * angle)};
}

inline void exp(const double* v, double* R) {
    const double q = square(v);
    const SineTerms terms = sine_terms(q);
    combined(v, 1 - terms.b * q, terms.a, terms.b, R);
}

inline void right_jacobian(const double* v, double* J) {
    const double q = square(v);
    const SineTerms terms = sine_terms(q);
    combined(v, 1 - terms.c * q, -terms.b, terms.c, J);
}

inline void inverse_right_jacobian(const double* v, double* J) {
    const double q = square(v);
    const double series = 1. / 12 + q * (1. / 720 + q / 30240);
    if (q < SMALL_SQUARE) return combined(v, 1 - q * series, 0.5, series, J);
    const double half = 0.5 * std::sqrt(q), cotangent = half / std::tan(half);
    combined(v, cotangent, 0.5, (1 - cotangent) / q, J);
}

inline void log(const double* R, double* v) {
    const double trace = R[0] + R[4] + R[8];
    const double skew[3] = {R[7] - R[5], R[2] - R[6], R[3] - R[1]};
    const double sine = 0.5 * std::sqrt(square(skew)), angle = std::atan2(sine, 0.5 * (trace - 1));
    if (trace < 0) {  // near π the axis is taken from the longest column of (1 − cos θ) a aᵀ
        double outer[9];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) outer[3 * i + j] = R[3 * i + j] + R[3 * j + i] - (i == j ? trace - 1 : 0.0);
        int longest = 0;
        for (int i = 1; i < 3; i++)
            if (outer[4 * i] > outer[4 * longest]) longest = i;
        const double* axis = outer + 3 * longest;
        const double along = axis[0] * skew[0] + axis[1] * skew[1] + axis[2] * skew[2];
        const double scale = (along < 0 ? -angle : angle) / std::sqrt(square(axis));
        for (int i = 0; i < 3; i++) v[i] = scale * axis[i];
        return;
    }
    const double scale = sine < 1e-12 ? 0.5 : 0.5 * angle / sine;
    for (int i = 0; i < 3; i++) v[i] = scale * skew[i];
}

inline void hat(const double* v, double* M) { combined(v, 0.0, 1.0, 0.0, M); }

// C = A B of matrices (n, k) and (k, m)
template <int n, int k, int m> inline void product(const double* A, const double* B, double* C) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < m; j++) {
            double sum = 0;
            for (int l = 0; l < k; l++) sum += A[i * k + l] * B[l * m + j];
            C[i * m + j] = sum;
        }
}

// Right Jacobian (6, 6) of SE(3), rotation first; see vip_factors/geometry/poses.py.
inline void pose_right_jacobian(const double* step, double* J) {
    const double turn[3] = {-step[0], -step[1], -step[2]}, shift[3] = {-step[3], -step[4], -step[5]}, q = square(turn);
    double a = 1. / 6 - q / 120, b = 1. / 24 - q / 720, c = 1. / 120 - q / 2520;
    if (q >= SMALL_SQUARE) {
        const double angle = std::sqrt(q), sine = std::sin(angle);
        a = (angle - sine) / (q * angle), b = (q / 2 + std::cos(angle) - 1) / (q * q);
        c = 0.5 * (b + 3 * (angle - sine - q * angle / 6) / (q * q * angle));
    }
    double rotation[9], P[9], S[9], PS[9], SP[9], PSP[9], PPS[9], SPP[9], PSPP[9], PPSP[9];
    right_jacobian(step, rotation), hat(turn, P), hat(shift, S);
    product<3, 3, 3>(P, S, PS), product<3, 3, 3>(S, P, SP), product<3, 3, 3>(PS, P, PSP), product<3, 3, 3>(P, PS, PPS);
    product<3, 3, 3>(SP, P, SPP), product<3, 3, 3>(PSP, P, PSPP), product<3, 3, 3>(P, PSP, PPSP);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int at = 3 * i + j;
            J[6 * i + j] = J[6 * (i + 3) + j + 3] = rotation[at], J[6 * i + j + 3] = 0.0;
            J[6 * (i + 3) + j] = S[at] / 2 + a * (PS[at] + SP[at] + PSP[at]) + b * (PPS[at] + SPP[at] - 3 * PSP[at]) +
                                 c * (PSPP[at] + PPSP[at]);
        }
}

}  // namespace vip
