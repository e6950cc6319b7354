/* SPDX-License-Identifier: Apache-2.0 */
/* Depths that hide whole bands of noted cells. It is plain C, in a file of the vector kernels for
 * its compiler flags: the compiler handles a band in four registers. */
#include "bake/depth/cells_avx512.h"

#include <string.h>

void umbb__cells_hiding_avx512(const struct umbb_cells *cells, enum umbb_layer layer,
                               struct umbb__hiding *hiding)
{
    const size_t across = (size_t)(cells->n >> 3);
    memset(hiding, 0, sizeof *hiding);
    hiding->far = cells->layers[layer].far;
    for (size_t band = 0; band < across; band++) {
        const int32_t *far = hiding->far + band * across;
        int32_t most = 0;
        for (size_t i = 0; i < across; i++) {
            most = far[i] > most ? far[i] : most;
        }
        hiding->band_far[band] = most;
        hiding->all_far = most > hiding->all_far ? most : hiding->all_far;
    }
}
