/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_RATE_LIMIT_H
#define UMBRAGE_SERVER_DAEMON_RATE_LIMIT_H
/*
 * Rates, weighted by points, for single addresses and tokens; and the table of addresses.
 *
 * A rate is one number, the time until which what was taken so far is paid for. A taker may be a
 * second ahead; the batch that goes beyond is still answered, however large, and what follows
 * waits until it is paid for. So any batch passes, and the mean rate holds.
 *
 * Threads: taking is one atomic exchange. The table's mutex is held when connections come and go.
 */
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/socket.h>

#define UMBD_RATE_AHEAD_NS 1000000000U
#define UMBD_CALL_POINTS   64 /* what a call costs beside its points */

/*
 * Takes `points` at `per_second` (0 = no limit).
 * Out: wait_ns: if refused, the time after which it would not be. Returns 1, or 0 and takes
 * nothing.
 */
int umbd_rate_take(atomic_uint_fast64_t *paid_until_ns, uint64_t per_second, uint64_t points,
                   uint64_t now_ns, uint64_t *wait_ns);

/* Gives back what was taken for work that was then refused elsewhere. */
void umbd_rate_return(atomic_uint_fast64_t *paid_until_ns, uint64_t per_second, uint64_t points);

/* One address that has connections, or has debts. */
struct umbd_peer_account {
    struct umbd_peer_account *next;
    uint8_t key[9]; /* family, then IPv4 or the first half of IPv6: what one customer has */
    size_t connections;
    atomic_uint_fast64_t paid_until_ns;
};

struct umbd_peer_table; /* opaque */

/* NULL: out of memory. */
struct umbd_peer_table *umbd_peers_create(void);
void umbd_peers_destroy(struct umbd_peer_table *table);

/*
 * Counts a connection of an address (NULL: Unix socket) and gives its account, valid until the
 * release. Returns 1, or 0 with the reason: the address has `limit` connections, or no memory.
 */
int umbd_peers_acquire(struct umbd_peer_table *table, const struct sockaddr_storage *address,
                       size_t limit, struct umbd_peer_account **out, const char **reason);
void umbd_peers_release(struct umbd_peer_table *table, struct umbd_peer_account *account,
                        uint64_t now_ns);

#endif
