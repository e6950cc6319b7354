/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_RATE_LIMIT_H
#define UMBRAGE_SERVER_DAEMON_BASE_RATE_LIMIT_H
/*
 * Rates, weighted by points, for single addresses and tokens; and the table of addresses.
 *
 * A rate is one number: the time until which everything taken so far is paid for. It may be a
 * second ahead of the clock. The batch that goes beyond is still answered, however large, and later
 * ones wait until it is paid for. So any batch passes, and the mean rate holds.
 *
 * Threads: taking is one atomic exchange. The table's mutex is held when connections come and go.
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
 * Takes `points` at `per_second` (0 = no limit). Returns 1, or 0 and takes nothing.
 * Out: wait_ns: if refused, the time after which it would succeed.
 */
int umbd_rate_take(atomic_uint_fast64_t *paid_until_ns, uint64_t per_second, uint64_t points,
                   uint64_t now_ns, uint64_t *wait_ns);

/* Takes points beyond the rate if needed: later takers wait until they are paid for. */
void umbd_rate_owe(atomic_uint_fast64_t *paid_until_ns, uint64_t per_second, uint64_t points,
                   uint64_t now_ns);

/* Returns points of work that was then refused for another reason. */
void umbd_rate_return(atomic_uint_fast64_t *paid_until_ns, uint64_t per_second, uint64_t points);

#define UMBD_PEER_KEY_BYTES 9

/* Account of an address that has connections, or work that is not paid for. */
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
 * Writes the key of an address's account: the family, then the IPv4 address or the first half of
 * the IPv6 address (a customer has a /64). IPv4 that comes as IPv6 (a dual-stack listener's
 * ::ffff:a.b.c.d, NAT64's 64:ff9b::a.b.c.d) is keyed as IPv4; link-local addresses share one half
 * and are keyed by the other. NULL (a Unix socket): zeros.
 */
void umbd_peer_key(const struct sockaddr_storage *address, uint8_t key[UMBD_PEER_KEY_BYTES]);

struct umbd_peer_table; /* opaque */

/* Makes an empty table. NULL: out of memory, or no random bytes. */
struct umbd_peer_table *umbd_peers_create(void);
void umbd_peers_destroy(struct umbd_peer_table *table);

/* Number of the chain with an address's account. Each table has an order of its own. */
size_t umbd_peers_chain(const struct umbd_peer_table *table,
                        const uint8_t key[UMBD_PEER_KEY_BYTES]);

/*
 * Counts a connection of an address (NULL: Unix socket) and gives its account, valid until the
 * release. Returns 1, or 0 with the reason: the address has `limit` connections, or no memory.
 * Out: strangers: Number of the address's connections without rights; 0 without memory.
 */
int umbd_peers_acquire(struct umbd_peer_table *table, const struct sockaddr_storage *address,
                       size_t limit, struct umbd_peer_account **out, size_t *strangers,
                       const char **reason);
void umbd_peers_release(struct umbd_peer_table *table, struct umbd_peer_account *account,
                        uint64_t now_ns);

#endif
