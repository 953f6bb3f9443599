// What the mock answers: method, path, handler.
import * as site from "./site.js";

const page = (all, { query }) => {
  const wanted = all.filter((item) =>
    ["kind", "module", "point"].every((name) => !query.get(name) || item[name] === query.get(name)),
  );
  const begin = Number(query.get("cursor") ?? 0);
  const end = begin + Number(query.get("limit") ?? 50);
  return { schema: 1, items: wanted.slice(begin, end), next: end < wanted.length ? String(end) : null };
};

export const routes = [
  ["GET", /^\/session$/, () => site.session],
  ["GET", /^\/lines$/, () => ({ schema: 1, lines: site.lines })],
  ["GET", /^\/modules$/, () => ({ schema: 1, modules: site.modules })],
  ["GET", /^\/points$/, () => ({ schema: 1, points: site.points })],
  [
    "GET",
    /^\/history$/,
    ({ query }) =>
      site.history(query.get("point"), Date.parse(query.get("from")), Date.parse(query.get("to")), Number(query.get("buckets"))),
  ],
  ["GET", /^\/events$/, (asked) => page(site.events, asked)],
  [
    "POST",
    /^\/events\/(\w+)\/ack$/,
    ({ at, body }) => {
      const event = site.events.find((event) => event.id === at[0]);
      event.acked = { who: "anna", at: new Date().toISOString(), comment: body.comment };
      return event;
    },
  ],
  ["GET", /^\/audit$/, (asked) => page(site.audit, asked)],
  ["GET", /^\/audit\/verify$/, () => ({ schema: 1, entries: site.audit.length, ok: true })],
];
