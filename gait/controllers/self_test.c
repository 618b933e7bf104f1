#include <stdio.h>

/* Read the test vectors, and compare the numbers at the end of each row with the answer to it. */
int main(void)
{
    $TYPE row[$COLUMNS], found[$ANSWERS];
    double worst = 0;
    long steps = 0, different = 0;

    for (int c = getchar(); c != '\n' && c != EOF;)
        c = getchar();
    for (;; steps++) {
        for (int i = 0; i < $COLUMNS; i++)
            if (scanf("$FORMAT%*c", &row[i]) != 1) {
                if (steps == 0 || i > 0 || !feof(stdin)) {
                    printf("row %ld on standard input is no test vector\n", steps + 1);
                    return 1;
                }
                printf("%ld steps, %ld numbers differ, by at most %g\n", steps, different, worst);
                return different != 0;
            }
        NAME_answer(steps, row, found);
        for (int i = 0; i < $ANSWERS; i++) {
            const double off = fabs((double)found[i] - (double)row[$COLUMNS - $ANSWERS + i]);
            different += !(off <= 0); /* NaN, too */
            worst = off > worst ? off : worst;
        }
    }
}
