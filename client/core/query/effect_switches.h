/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_QUERY_EFFECT_SWITCHES_H
#define UMBRAGE_CORE_QUERY_EFFECT_SWITCHES_H
/*
 * Effects that queries know of. Every product has all of them. With -DUMB_WITHOUT_PENUMBRA and the
 * like the compiler leaves one out: such builds exist to prove that an effect which is off costs a
 * query nothing, tests/system/test_effect_costs.sh counts their instructions. So whatever a query
 * does for an effect stands behind its switch, and the switch stands nowhere but where a batch's
 * stages are chosen.
 */

/* Half shadows of lights that are no points (kernel_penumbra.c). */
#ifdef UMB_WITHOUT_PENUMBRA
#define UMB__HAS_PENUMBRA 0
#else
#define UMB__HAS_PENUMBRA 1
#endif

/* Spot and point lights (perspective.c). */
#ifdef UMB_WITHOUT_FACES
#define UMB__HAS_FACES 0
#else
#define UMB__HAS_FACES 1
#endif

/* Look-ups that stop at a level (kernel_coarse_body.h). */
#ifdef UMB_WITHOUT_LEVELS
#define UMB__HAS_LEVELS 0
#else
#define UMB__HAS_LEVELS 1
#endif

/* Patches of surface that pixels cover (kernel_footprint.c). */
#ifdef UMB_WITHOUT_FOOTPRINTS
#define UMB__HAS_FOOTPRINTS 0
#else
#define UMB__HAS_FOOTPRINTS 1
#endif

/* Translucent casters (transmittance_stage.c). */
#ifdef UMB_WITHOUT_TRANSMITTANCE
#define UMB__HAS_TRANSMITTANCE 0
#else
#define UMB__HAS_TRANSMITTANCE 1
#endif

/* Assets whose receivers do not move (receiver_mask_stage.c). */
#ifdef UMB_WITHOUT_STATIC
#define UMB__HAS_STATIC 0
#else
#define UMB__HAS_STATIC 1
#endif

#endif
