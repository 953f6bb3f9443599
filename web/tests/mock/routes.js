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

const problem = (status, code, title) => ({ status, code, title, detail: title });

function drop(list, fits) {
  const at = list.findIndex(fits);
  if (at < 0) return problem(404, "E0120", "there is no such thing");
  return list.splice(at, 1)[0];
}

/** A line that says `wrong` is wrong. */
function faults(text) {
  return text.split("\n").flatMap((line, i) =>
    line.includes("wrong") ? [{ line: i + 1, column: 1, path: "", code: "E0812", reason: "there is no such key" }] : [],
  );
}

export const routes = [
  ["GET", /^\/session$/, () => site.session],
  ["GET", /^\/lines$/, () => ({ schema: 1, lines: site.lines })],
  ["GET", /^\/models$/, () => ({ schema: 1, models: [] })],
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
  ["GET", /^\/users$/, () => ({ schema: 1, users: site.users })],
  [
    "POST",
    /^\/users$/,
    ({ body }) => {
      const { password, ...user } = body;
      if (password.length < 10) return problem(422, "E0905", "the password is too short");
      site.users.push({ ...user, locked: false, created: new Date().toISOString() });
      return user;
    },
  ],
  ["DELETE", /^\/users\/(\w+)$/, ({ at }) => drop(site.users, (user) => user.name === at[0])],
  ["GET", /^\/tokens$/, () => ({ schema: 1, tokens: site.tokens })],
  [
    "POST",
    /^\/tokens$/,
    ({ body }) => {
      const { name, role, points, expires_days } = body;
      const made = { id: `t${site.tokens.length + 1}`, name, role, points };
      site.tokens.push({ ...made, expires: new Date(Date.now() + expires_days * 86_400_000).toISOString() });
      return { ...made, token: "rb_secret_shown_once" };
    },
  ],
  ["DELETE", /^\/tokens\/(\w+)$/, ({ at }) => drop(site.tokens, (token) => token.id === at[0])],
  ["GET", /^\/sessions$/, () => ({ schema: 1, sessions: site.sessions })],
  ["GET", /^\/groups$/, () => ({ schema: 1, groups: site.groups })],
  [
    "POST",
    /^\/groups\/(\w+)\/set$/,
    ({ body }) => {
      if (!body.confirm) return problem(409, "E0407", "the point asks for a confirmation");
      const why = { code: "E0301", title: "the module does not answer", status: 504 };
      return { results: [{ path: "pump.do0", confirmed: "readback" }, { path: "pump.do1", error: why }], undone: false };
    },
  ],
  ["GET", /^\/scenes$/, () => ({ schema: 1, scenes: site.scenes })],
  ["GET", /^\/config$/, () => ({ schema: 1, file: "/etc/railbus/railbus.toml", ...site.config() })],
  ["POST", /^\/config\/check$/, ({ body }) => ({ schema: 1, problems: faults(body.text), warnings: [] })],
  [
    "PUT",
    /^\/config$/,
    ({ body, headers }) => {
      if (headers["if-match"] !== `"${site.config().etag}"`) return problem(412, "E0810", "it was changed meanwhile");
      const problems = faults(body.text);
      if (problems.length) return { ...problem(422, "E0801", "the configuration is wrong"), problems };
      return site.write(body.text);
    },
  ],
  ["GET", /^\/config\/generations$/, () => ({ schema: 1, generations: site.generations.map(({ text, ...about }) => about) })],
  ["GET", /^\/config\/generations\/(\d+)$/, ({ at }) => site.generations.find((one) => String(one.id) === at[0])],
  ["POST", /^\/config\/undo$/, ({ body }) => site.write(site.generations.find((one) => one.id === body.to).text)],
  ["GET", /^\/system$/, () => site.system],
  ["GET", /^\/storage$/, () => site.storage],
  ["GET", /^\/doctor$/, () => site.doctor],
  ["GET", /^\/openapi\.json$/, () => site.document],
];
