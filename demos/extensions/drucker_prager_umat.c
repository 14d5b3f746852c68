/* Drucker and Prager's soil as a UMAT in C, with a flow rule that need not be associated.
 *
 *     cc -O2 -shared -fPIC -o drucker_prager_umat.so drucker_prager_umat.c -lm
 *
 * Yields at q + alpha p = k and flows by d eps_p = d gamma  d(q + beta p)/d sigma; p is the mean
 * stress, tension positive, and q = sqrt(3 J2).  With alpha = beta = 0 it is von Mises's soil.
 *
 * PROPS:  E (Pa), nu, alpha, beta, k (Pa).   STATEV:  gamma, summed over the steps.
 *
 * A UMAT is called for one point: it has the stress and state variables before the step and the
 * increment of strain, and returns both after it, and DDSDDE = d stress / d strain, by columns.
 * NDI = 3 normal components come first, then NSHR shear ones, with engineering shear strains.
 * Everything is passed by its address, as Fortran does it; the last argument, which Fortran hides,
 * is the length of CMNAME.
 */
#include <math.h>
#include <stddef.h>

/* Elastic stiffness times a strain increment, added to the stress. */
static void add_elastic(double K, double G, int ndi, int n, const double *strain, double *stress)
{
    double volume = 0.0;
    for (int i = 0; i < ndi; i++) volume += strain[i];
    for (int i = 0; i < n; i++)
        stress[i] += i < ndi ? 2.0 * G * strain[i] + (K - 2.0 * G / 3.0) * volume : G * strain[i];
}

/* Mean stress, deviator (n) and q of a stress. */
static double split(int ndi, int n, const double *stress, double *deviator, double *q)
{
    double mean = 0.0, sum = 0.0;
    for (int i = 0; i < ndi; i++) mean += stress[i] / 3.0;
    for (int i = 0; i < n; i++) {
        deviator[i] = i < ndi ? stress[i] - mean : stress[i];
        sum += (i < ndi ? 1.0 : 2.0) * deviator[i] * deviator[i];
    }
    *q = sqrt(1.5 * sum);
    return mean;
}

/* a 1 x 1 + 2 b I_dev, by columns. */
static void isotropic(double a, double b, int ndi, int n, double *D)
{
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++) {
            double unit = i != j ? 0.0 : i < ndi ? 2.0 : 1.0;
            D[i + n * j] = b * unit + (i < ndi && j < ndi ? a - 2.0 * b / 3.0 : 0.0);
        }
}

void umat_(double *stress, double *statev, double *ddsdde, double *sse, double *spd, double *scd,
           double *rpl, double *ddsddt, double *drplde, double *drpldt, double *stran,
           double *dstran, double *time, double *dtime, double *temp, double *dtemp,
           double *predef, double *dpred, char *cmname, int *ndi, int *nshr, int *ntens,
           int *nstatv, double *props, int *nprops, double *coords, double *drot, double *pnewdt,
           double *celent, double *dfgrd0, double *dfgrd1, int *noel, int *npt, int *layer,
           int *kspt, int *kstep, int *kinc, size_t length_of_cmname)
{
    const double E = props[0], nu = props[1], alpha = props[2], beta = props[3], k = props[4];
    const double K = E / (3.0 * (1.0 - 2.0 * nu)), G = E / (2.0 * (1.0 + nu));
    const int n = *ntens, normal = *ndi;
    double s[6], q;

    /* the step as if it were elastic */
    add_elastic(K, G, normal, n, dstran, stress);
    const double p = split(normal, n, stress, s, &q);
    const double beyond = q + alpha * p - k;
    if (beyond <= 1e-13 * k) {
        isotropic(K, G, normal, n, ddsdde);
        return;
    }

    /* back to the cone, along its flow: q - 3 G gamma, p - K beta gamma */
    const double h = 3.0 * G + K * alpha * beta, gamma = beyond / h;
    const double left = q - 3.0 * G * gamma;
    if (left < 0.0) { /* beyond the apex: to it */
        const double apex = k / alpha;
        for (int i = 0; i < n; i++) stress[i] = i < normal ? apex : 0.0;
        if (beta > 0.0) statev[0] += (p - apex) / (K * beta);
        isotropic(0.0, 0.0, normal, n, ddsdde);
        return;
    }
    const double ratio = left / q, mean = p - K * beta * gamma;
    for (int i = 0; i < n; i++) stress[i] = ratio * s[i] + (i < normal ? mean : 0.0);
    statev[0] += gamma;

    /* the derivative of these lines: by_q = dq/d eps and by_p = dp/d eps of the trial */
    isotropic(K, ratio * G, normal, n, ddsdde);
    for (int j = 0; j < n; j++) {
        const double by_q = 3.0 * G * s[j] / q, by_p = j < normal ? K : 0.0;
        const double flow = (by_q + alpha * by_p) / h; /* d gamma / d eps */
        for (int i = 0; i < n; i++) {
            ddsdde[i + n * j] += s[i] / q * ((1.0 - ratio) * by_q - 3.0 * G * flow);
            if (i < normal) ddsdde[i + n * j] -= K * beta * flow;
        }
    }
}
