/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_TRADE_REPORT_H
#define UMBRAGE_SERVER_STUDY_TRADE_REPORT_H
/* What the files of a study's report share. */
#include <stdio.h>
#include "study/trade.h"
#include "tool/json.h"

/* The whole study as one JSON object. A failed write shows in ferror(to). */
void umbt_trade_json(FILE *to, const struct umbt_trade *trade);

/* Writes the members of that object. */
void umbt_trade_put(struct umbu_json *json, const struct umbt_trade *trade);

/* The same as a page that needs nothing else: numbers, charts, pictures. */
void umbt_trade_page(FILE *to, const struct umbt_trade *trade);

#endif
