#ifndef NAME_H_$EXPORT
#error "NAME.h and NAME.c are of two exports: use the two that were written together"
#endif
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) \
    || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(_M_FP_FAST)
#error "-ffast-math reorders sums and takes NaN for a number: compile this file with -fno-fast-math"
#endif
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16
#error "float is rounded late here: on 32-bit x86 compile this file with -msse2 -mfpmath=sse"
#endif
#if FLT_RADIX != 2 || FLT_MANT_DIG != 24 || FLT_MAX_EXP != 128
#error "this file needs the float of IEEE 754, which has 32 bits"
#endif
//? double
#if DBL_MANT_DIG != 53 || DBL_MAX_EXP != 1024
#error "this file needs a double of 64 bits: AVR has none, other compilers have an option"
#endif
/* An array of negative size where -fsingle-precision-constant makes 1.0 a float. */
typedef char NAME_must_be_compiled_without_single_precision_constants
    [sizeof(1.0) == sizeof(double) ? 1 : -1];
//.

