/* Replaces the C library's reduction of angles beyond a million radians, 4 kB (gzip): their
 * sine and cosine are not numbers, and truepose refuses them as such. */
int __rem_pio2_large(double* x, double* y, int e0, int nx, int precision);
int __rem_pio2_large(double* x, double* y, int e0, int nx, int precision) {
  (void)x, (void)e0, (void)nx, (void)precision;
  y[0] = y[1] = __builtin_nan("");
  return 0;
}
