/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Rates by the generic cell rate algorithm (ITU-T I.371, virtual scheduling), with debts; and the
 * table of addresses. An address without connections stays in the table until its debts are paid,
 * so a new connection does not cancel them. The next walk through the address's hash chain then
 * removes it.
 */
#include "daemon/base/rate_limit.h"

#include <netinet/in.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <xxhash.h>

#define BUCKETS     1024   /* a power of 2 */
#define COST_MAX_NS 3.6e12 /* an hour: no single batch closes an address for longer */

static uint64_t cost_ns(uint64_t per_second, uint64_t points)
{
    double cost = (double)points * 1e9 / (double)per_second;
    return (uint64_t)(cost < COST_MAX_NS ? cost : COST_MAX_NS);
}

int umbd_rate_take(atomic_uint_fast64_t *paid_until_ns, uint64_t per_second, uint64_t points,
                   uint64_t now_ns, uint64_t *wait_ns)
{
    *wait_ns = 0;
    if (per_second == 0) {
        return 1;
    }
    uint64_t until = atomic_load_explicit(paid_until_ns, memory_order_relaxed);
    uint64_t next;
    do {
        if (until > now_ns + UMBD_RATE_AHEAD_NS) {
            *wait_ns = until - now_ns - UMBD_RATE_AHEAD_NS;
            return 0;
        }
        next = (until > now_ns ? until : now_ns) + cost_ns(per_second, points);
    } while (!atomic_compare_exchange_weak_explicit(paid_until_ns, &until, next,
                                                    memory_order_relaxed, memory_order_relaxed));
    return 1;
}

void umbd_rate_owe(atomic_uint_fast64_t *paid_until_ns, uint64_t per_second, uint64_t points,
                   uint64_t now_ns)
{
    uint64_t until = atomic_load_explicit(paid_until_ns, memory_order_relaxed);
    uint64_t next;
    if (per_second == 0) {
        return;
    }
    do {
        /* A debt is paid within an hour at most. This limits the price of a single call, and of
         * calls at the same time. */
        const uint64_t most = now_ns + (uint64_t)COST_MAX_NS;
        const uint64_t from = until > now_ns ? until : now_ns;
        next = from + cost_ns(per_second, points);
        next = next > most ? (from > most ? from : most) : next;
    } while (!atomic_compare_exchange_weak_explicit(paid_until_ns, &until, next,
                                                    memory_order_relaxed, memory_order_relaxed));
}

void umbd_rate_return(atomic_uint_fast64_t *paid_until_ns, uint64_t per_second, uint64_t points)
{
    if (per_second > 0) { /* undoes exactly the taking, so the value never passes below zero */
        atomic_fetch_sub_explicit(paid_until_ns, cost_ns(per_second, points), memory_order_relaxed);
    }
}

struct umbd_peer_table {
    pthread_mutex_t mutex;
    uint64_t seed; /* Secret of the hash */
    struct umbd_peer_account *chains[BUCKETS];
};

struct umbd_peer_table *umbd_peers_create(void)
{
    struct umbd_peer_table *table = calloc(1, sizeof *table);
    if (table == NULL ||
        getrandom(&table->seed, sizeof table->seed, 0) != (ssize_t)sizeof table->seed) {
        free(table);
        return NULL;
    }
    pthread_mutex_init(&table->mutex, NULL);
    return table;
}

void umbd_peers_destroy(struct umbd_peer_table *table)
{
    if (table == NULL) {
        return;
    }
    for (size_t i = 0; i < BUCKETS; i++) {
        while (table->chains[i] != NULL) {
            struct umbd_peer_account *next = table->chains[i]->next;
            free(table->chains[i]);
            table->chains[i] = next;
        }
    }
    pthread_mutex_destroy(&table->mutex);
    free(table);
}

/* Returns 1 if the last four bytes are an IPv4 address: ::ffff:0:0/96 (RFC 4291), 64:ff9b::/96 (RFC
 * 6052). */
static int holds_v4(const struct in6_addr *address)
{
    static const uint8_t nat64[12] = {0x00, 0x64, 0xff, 0x9b};
    return IN6_IS_ADDR_V4MAPPED(address) || memcmp(address->s6_addr, nat64, sizeof nat64) == 0;
}

void umbd_peer_key(const struct sockaddr_storage *address, uint8_t key[UMBD_PEER_KEY_BYTES])
{
    memset(key, 0, UMBD_PEER_KEY_BYTES);
    if (address == NULL) {
        return;
    }
    if (address->ss_family == AF_INET) {
        struct sockaddr_in v4;
        memcpy(&v4, address, sizeof v4);
        key[0] = 4;
        memcpy(key + 1, &v4.sin_addr, 4);
    } else {
        struct sockaddr_in6 v6;
        memcpy(&v6, address, sizeof v6);
        const int by_v4 = holds_v4(&v6.sin6_addr);
        key[0] = by_v4 ? 4 : 6;
        if (by_v4) {
            memcpy(key + 1, v6.sin6_addr.s6_addr + 12, 4);
        } else {
            memcpy(key + 1, v6.sin6_addr.s6_addr + (IN6_IS_ADDR_LINKLOCAL(&v6.sin6_addr) ? 8 : 0),
                   8);
        }
    }
}

/* The secret seed keeps a peer from choosing addresses that all fall into one chain. A peer may
 * have many IPv6 addresses, and all loops wait while one walks through a chain. */
size_t umbd_peers_chain(const struct umbd_peer_table *table, const uint8_t key[UMBD_PEER_KEY_BYTES])
{
    return (size_t)XXH3_64bits_withSeed(key, UMBD_PEER_KEY_BYTES, table->seed) & (BUCKETS - 1);
}

static struct umbd_peer_account **chain_of(struct umbd_peer_table *table,
                                           const uint8_t key[UMBD_PEER_KEY_BYTES])
{
    return &table->chains[umbd_peers_chain(table, key)];
}

int umbd_peers_acquire(struct umbd_peer_table *table, const struct sockaddr_storage *address,
                       size_t limit, struct umbd_peer_account **out, size_t *strangers,
                       const char **reason)
{
    uint8_t key[UMBD_PEER_KEY_BYTES];
    umbd_peer_key(address, key);
    *out = NULL;
    *reason = "out of memory";
    pthread_mutex_lock(&table->mutex);
    struct umbd_peer_account **chain = chain_of(table, key);
    struct umbd_peer_account *account = *chain;
    while (account != NULL && memcmp(account->key, key, sizeof key) != 0) {
        account = account->next;
    }
    if (account == NULL) {
        account = calloc(1, sizeof *account);
        if (account != NULL) {
            memcpy(account->key, key, sizeof key);
            account->next = *chain;
            *chain = account;
        }
    }
    *strangers = account != NULL ? atomic_load(&account->strangers) : 0;
    if (account != NULL && account->connections >= limit) {
        *reason = "too many connections of one address";
        account = NULL;
    }
    if (account != NULL) {
        account->connections++;
    }
    pthread_mutex_unlock(&table->mutex);
    *out = account;
    return account != NULL;
}

/* 1 if the account has a debt, which removing the account would cancel. */
static int owes(struct umbd_peer_account *account, uint64_t now_ns)
{
    return atomic_load(&account->paid_until_ns) > now_ns ||
           atomic_load(&account->open_until_ns) > now_ns ||
           atomic_load(&account->handshake_until_ns) > now_ns;
}

void umbd_peers_release(struct umbd_peer_table *table, struct umbd_peer_account *account,
                        uint64_t now_ns)
{
    if (account == NULL) {
        return;
    }
    pthread_mutex_lock(&table->mutex);
    struct umbd_peer_account **at = chain_of(table, account->key);
    account->connections--;
    while (*at != NULL) {
        struct umbd_peer_account *one = *at;
        if (one->connections == 0 && !owes(one, now_ns)) {
            *at = one->next;
            free(one);
        } else {
            at = &one->next;
        }
    }
    pthread_mutex_unlock(&table->mutex);
}
