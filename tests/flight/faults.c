/* A flight in S-turns with one fault from 60 s on, over the emitted ins15: GNSS at 10 Hz, IMU at 100 Hz.
 * Arguments: number of the fault, seed. Prints: seconds until the filter said so, seconds from the fault's end until it
 * was right again for good, longest time that it was wrong and said OK [s], worst error of position [m], how often a
 * word was no finite number, seconds until the condition was OK again.
 * "Wrong" is a position off by more than three standard deviations, all axes together. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "ins15.h"

#define DT 0.01
#define STEPS 18000
#define PER_FIX 10
#define START 60.0
#define GRAVITY 9.80665

typedef struct { double p[3], v[3], q[4]; } truth_t;

static unsigned long long state = 1;

static double uniform(void)
{
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return ((double)(state >> 11) + 0.5) / 9007199254740992.0;
}

static double normal(void)
{
    return sqrt(-2.0 * log(uniform())) * cos(6.283185307179586 * uniform());
}

static void product(const double a[4], const double b[4], double out[4])
{
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

/* v in the axes that q leads from. */
static void into_body(const double q[4], const double v[3], double out[3])
{
    const double back[4] = { q[0], -q[1], -q[2], -q[3] }, pure[4] = { 0.0, v[0], v[1], v[2] };
    double half[4], all[4];
    product(back, pure, half);
    product(half, q, all);
    for (int i = 0; i < 3; i++) {
        out[i] = all[i + 1];
    }
}

/* Forward speed of 20 m/s with a swell, heading that swings, coordinated bank. */
static truth_t truth(double t)
{
    truth_t x;
    const double heading = 1.5 * sin(0.25 * t) + 0.02 * t, rate = 0.375 * cos(0.25 * t) + 0.02;
    const double speed = 20.0 + 2.0 * sin(0.5 * t), bank = atan(speed * rate / GRAVITY);
    const double yaw[4] = { cos(heading / 2.0), 0.0, 0.0, sin(heading / 2.0) };
    const double roll[4] = { cos(bank / 2.0), sin(bank / 2.0), 0.0, 0.0 };
    x.v[0] = speed * cos(heading);
    x.v[1] = speed * sin(heading);
    x.v[2] = 1.0 * sin(0.4 * t);
    product(yaw, roll, x.q);
    x.p[0] = x.p[1] = x.p[2] = 0.0;
    return x;
}

/* What an IMU gives from one truth to the next: mean rate, and mean specific force in the axes of the middle. */
static void measured(const truth_t *a, const truth_t *b, double gyro[3], double accel[3])
{
    const double back[4] = { a->q[0], -a->q[1], -a->q[2], -a->q[3] };
    double turn[4], middle[4], half[4], f[3];
    product(back, b->q, turn);
    const double s = sqrt(turn[1] * turn[1] + turn[2] * turn[2] + turn[3] * turn[3]);
    const double angle = 2.0 * atan2(s, turn[0]), k = (s > 1e-12) ? angle / s : 2.0;
    half[0] = cos(angle / 4.0);
    for (int i = 0; i < 3; i++) {
        gyro[i] = turn[i + 1] * k / DT;
        half[i + 1] = (s > 1e-12) ? turn[i + 1] / s * sin(angle / 4.0) : 0.0;
        f[i] = (b->v[i] - a->v[i]) / DT;
    }
    f[2] -= GRAVITY;
    product(a->q, half, middle);
    into_body(middle, f, accel);
}

enum {
    NONE, NAN_GYRO, NO_STEP, LONG_STEP, STUCK_ACCEL, FROZEN_GNSS, WRONG_HEADING, JUMP, HUGE_GYRO, HUGE_ACCEL,
    INF_ACCEL, NAN_GNSS, OUTAGE, GNSS_SPIKES, NEGATIVE_STEP, STUCK_GYRO, IMU_LOST, FAULTS
};
static const double lasts[FAULTS] = {
    0.0, 1.0, 5.0, 0.01, 30.0, 30.0, 0.01, 0.01, 0.01, 0.01, 0.5, 5.0, 20.0, 10.0, 1.0, 5.0, 0.5
};

int main(int argc, char **argv)
{
    static ins15_t kf;
    const int fault = (argc > 1) ? atoi(argv[1]) : 0;
    truth_t now = truth(0.0);
    double said = -1.0, wrong_last = -1.0, wrong_ok = 0.0, worst_ok = 0.0, worst = 0.0, not_ok_last = -1.0;
    double kept_gyro[3] = { 0 }, kept_accel[3] = { 0 }, kept_fix[6] = { 0 }, bias[6];
    int spoiled = 0;

    state = (unsigned long long)((argc > 2) ? atoi(argv[2]) : 1) * 2654435761ULL + 12345ULL;
    for (int i = 0; i < 200; i++) {
        (void)uniform();
    }
    for (int i = 0; i < 6; i++) {
        bias[i] = ((i < 3) ? 0.005 : 0.05) * normal();
    }
    (void)ins15_init(&kf);
    for (int i = 0; i < 4; i++) {
        kf.x[INS15_X_Q_W + i] = (REAL)now.q[i];
    }
    for (int i = 0; i < 3; i++) {
        kf.x[INS15_X_V_N + i] = (REAL)now.v[i];
    }
    for (int k = 0; k < STEPS; k++) {
        const double t = k * DT;
        const int active = (t >= START - 1e-9) && (t < START + lasts[fault] - 1e-9);
        truth_t next = truth(t + DT);
        double gyro[3], accel[3], fix[6], step = DT, error = 0.0, trace = 0.0;
        REAL w[3], f[3], z[3];
        kf_status_t status;
        measured(&now, &next, gyro, accel);
        for (int i = 0; i < 3; i++) {
            next.p[i] = now.p[i] + (now.v[i] + next.v[i]) / 2.0 * DT;
            gyro[i] += bias[i] + 1.5e-4 / sqrt(DT) * normal();
            accel[i] += bias[i + 3] + 2e-3 / sqrt(DT) * normal();
            if (!(active && fault == STUCK_ACCEL)) { kept_accel[i] = accel[i]; }
            if (!(active && fault == STUCK_GYRO)) { kept_gyro[i] = gyro[i]; }
            accel[i] = kept_accel[i];
            gyro[i] = kept_gyro[i];
            if (active && fault == NAN_GYRO) { gyro[i] = NAN; }
            if (active && fault == HUGE_GYRO) { gyro[i] = 1e8; }
            if (active && fault == HUGE_ACCEL) { accel[i] = 1e10; }
            if (active && fault == INF_ACCEL) { accel[i] = INFINITY; }
            w[i] = (REAL)gyro[i];
            f[i] = (REAL)accel[i];
        }
        if (active && fault == NO_STEP) { step = 0.0; }
        if (active && fault == LONG_STEP) { step = 10.0; }
        if (active && fault == NEGATIVE_STEP) { step = -DT; }
        if (active && fault == WRONG_HEADING) {
            const double turn[4] = { 0.5, 0.0, 0.0, 0.8660254037844386 };
            double q[4], out[4];
            for (int i = 0; i < 4; i++) { q[i] = (double)kf.x[INS15_X_Q_W + i]; }
            product(turn, q, out);
            for (int i = 0; i < 4; i++) { kf.x[INS15_X_Q_W + i] = (REAL)out[i]; }
        }
        status = KF_OK;
        if (!(active && fault == IMU_LOST)) {
            status = ins15_predict(&kf, f, w, (REAL)step);
        }
        now = next;
        if (k % PER_FIX == PER_FIX - 1 && !(active && fault == OUTAGE)) {
            for (int i = 0; i < 3; i++) {
                fix[i] = now.p[i] + 1.5 * normal() + ((fault == JUMP && t >= START) ? 577.35 : 0.0);
                fix[i + 3] = now.v[i] + 0.1 * normal();
            }
            for (int i = 0; i < 6; i++) {
                if (!(active && fault == FROZEN_GNSS)) { kept_fix[i] = fix[i]; }
                fix[i] = kept_fix[i];
                if (active && fault == NAN_GNSS) { fix[i] = NAN; }
                if (active && fault == GNSS_SPIKES && (k / PER_FIX) % 3 == 0) { fix[i] += 300.0; }
            }
            for (int part = 0; part < 2; part++) {
                kf_status_t found;
                for (int i = 0; i < 3; i++) { z[i] = (REAL)fix[3 * part + i]; }
                found = part ? ins15_update_gnss_velocity(&kf, z) : ins15_update_gnss_position(&kf, z);
                status = (found > status) ? found : status;
            }
        }
        {
            const kf_status_t condition = ins15_supervise(&kf);
            if (condition != KF_OK) { not_ok_last = t; }
            status = (condition > status) ? condition : status;
        }
        for (int i = 0; i < INS15_NX; i++) { spoiled += isfinite((double)kf.x[i]) ? 0 : 1; }
        for (int i = 0; i < INS15_N; i++) {
            spoiled += isfinite((double)ins15_get_variance(&kf, (ins15_e_t)i)) ? 0 : 1;
        }
        for (int i = 0; i < 3; i++) {
            const double e = (double)kf.x[i] - now.p[i] - ((fault == JUMP && t >= START) ? 577.35 : 0.0);
            error += e * e;
            trace += (double)ins15_get_variance(&kf, (ins15_e_t)i);
        }
        if (t >= START && status != KF_OK && said < 0.0) { said = t - START; }
        if (t > 20.0) {
            const int wrong = !(error <= 9.0 * trace);
            if (wrong) { wrong_last = t; }
            wrong_ok = (wrong && status == KF_OK) ? wrong_ok + DT : 0.0;
            worst_ok = (wrong_ok > worst_ok) ? wrong_ok : worst_ok;
            worst = (error > worst) ? error : worst;
        }
#ifdef VERBOSE
        if (t > START - 1.0 && k % 50 == 0) {
            double dot = 0.0;
            for (int i = 0; i < 4; i++) { dot += (double)kf.x[INS15_X_Q_W + i] * now.q[i]; }
            fprintf(stderr, "%6.2f err %9.3f sd %8.3f  att %7.3f deg  sd_h %6.3f v_err %7.3f status %d rej %g %g resets %g\n", t, sqrt(error), sqrt(trace),
                2.0 * acos(fmin(1.0, fabs(dot))) * 57.3, sqrt((double)ins15_get_variance(&kf, INS15_E_PHI_D)) , fabs((double)kf.x[3] - now.v[0]), (int)status, (double)kf.supervisor[1],
                (double)kf.supervisor[INS15_REJECTED_GNSS_VELOCITY], (double)kf.supervisor[INS15_RESETS]);
        }
#endif
    }
    {
        const double end = START + lasts[fault];
        printf("%.2f %.2f %.2f %.3g %d %.2f\n", said, (wrong_last > end) ? wrong_last - end : 0.0, worst_ok, sqrt(worst),
            spoiled, (not_ok_last > end) ? not_ok_last - end : 0.0);
    }
    return 0;
}
