/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_RATE_LIMIT_H
#define UMBRAGE_SERVER_DAEMON_BASE_RATE_LIMIT_H
/*
 * Rates in points a second, for single addresses and tokens; and the table of addresses.
 *
 * A rate is stored as one number: the time until which all points taken so far are paid for. That
 * time may be a second ahead of the clock. The batch that goes beyond is still answered, however
 * large, and later batches wait until it is paid for. So a batch of any size passes, and the mean
 * rate holds.
 *
 * Threads: taking points is one atomic exchange. The table's mutex is held when connections come
 * and go.
 */
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/socket.h>

#define UMBD_RATE_AHEAD_NS 1000000000U
#define UMBD_CALL_POINTS   64 /* price of a call in addition to its points */
/* Rate of one address: health, and calls refused for rights. */
#define UMBD_OPEN_CALLS_PER_SECOND 200
#define UMBD_OPEN_CALLS_OF_ONE     1 /* in addition, calls a second of each connection */

/*
 * Takes `points` from a rate of `per_second` (0 = no limit). Returns 1, or 0 if the rate is
 * exceeded; then nothing is taken.
 * Out:   wait_ns: after a refusal, the time in nanoseconds until the points would be granted.
 */
int umbd_rate_take(atomic_uint_fast64_t *paid_until_ns, uint64_t per_second, uint64_t points,
                   uint64_t now_ns, uint64_t *wait_ns);

/* Takes points even if they exceed the rate: later takers then wait until the points are paid
 * for. */
void umbd_rate_owe(atomic_uint_fast64_t *paid_until_ns, uint64_t per_second, uint64_t points,
                   uint64_t now_ns);

/* Returns points of work that was then refused for another reason. */
void umbd_rate_return(atomic_uint_fast64_t *paid_until_ns, uint64_t per_second, uint64_t points);

#define UMBD_PEER_KEY_BYTES 9

/* Account of an address that has connections, or points that are not paid for. */
struct umbd_peer_account {
    struct umbd_peer_account *next;
    uint8_t key[UMBD_PEER_KEY_BYTES]; /* Key by umbd_peer_key */
    size_t connections;
    atomic_size_t strangers;                 /* Number of those without rights, on all loops */
    atomic_uint_fast64_t paid_until_ns;      /* Points: --address-rate */
    atomic_uint_fast64_t open_until_ns;      /* Calls without rights: UMBD_OPEN_CALLS_PER_SECOND */
    atomic_uint_fast64_t handshake_until_ns; /* TLS handshakes: --address-handshakes */
    atomic_uint_fast64_t granted;            /* Bytes of --max-buffer that its connections hold */
};

/*
 * Writes the key of an address's account: the family, and then the IPv4 address or the first half
 * of the IPv6 address (a customer has a /64). An IPv4 address within an IPv6 one (::ffff:a.b.c.d of
 * a dual-stack listener, 64:ff9b::a.b.c.d of NAT64) gets the key of the IPv4 address. All
 * link-local addresses have the same first half, so their key is the second half. NULL (a Unix
 * socket) gives zeros.
 */
void umbd_peer_key(const struct sockaddr_storage *address, uint8_t key[UMBD_PEER_KEY_BYTES]);

struct umbd_peer_table; /* opaque */

/* Makes an empty table. NULL: out of memory, or no random bytes. */
struct umbd_peer_table *umbd_peers_create(void);
void umbd_peers_destroy(struct umbd_peer_table *table);

/* Returns the number of the hash chain for an address's account. Each table has another random
 * seed. */
size_t umbd_peers_chain(const struct umbd_peer_table *table,
                        const uint8_t key[UMBD_PEER_KEY_BYTES]);

/*
 * Counts a connection of an address (NULL: Unix socket) and gives the address's account, valid
 * until the release. Returns 1; or 0 and the reason: the address has `limit` connections, or memory
 * is short.
 *
 * Out:   strangers: number of the address's connections without rights; 0 if memory is short.
 */
int umbd_peers_acquire(struct umbd_peer_table *table, const struct sockaddr_storage *address,
                       size_t limit, struct umbd_peer_account **out, size_t *strangers,
                       const char **reason);
void umbd_peers_release(struct umbd_peer_table *table, struct umbd_peer_account *account,
                        uint64_t now_ns);

#endif
