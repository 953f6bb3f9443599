// A daemon for tests of pages: the built pages with the real policy, and the contract of the API.
import { createHash } from "node:crypto";
import { existsSync, readFileSync } from "node:fs";
import { createServer } from "node:http";
import { extname } from "node:path";
import { fileURLToPath } from "node:url";
import { routes } from "./routes.js";
import * as site from "./site.js";

const dist = fileURLToPath(new URL("../../dist/", import.meta.url));
const POLICY =
  "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; " +
  "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
const TYPES = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml" };

function page(path, response) {
  const file = existsSync(dist + path) && extname(path) ? path : "/index.html";
  const type = TYPES[extname(file)] ?? "application/octet-stream";
  response.writeHead(200, { "Content-Type": `${type}; charset=utf-8`, "Content-Security-Policy": POLICY });
  response.end(readFileSync(dist + file));
}

async function api(request, response, url) {
  let text = "";
  for await (const piece of request) text += piece;
  const body = text ? JSON.parse(text) : undefined;
  for (const [method, pattern, handler] of routes) {
    const found = pattern.exec(url.pathname.slice("/api/v1".length));
    if (method !== request.method || !found) continue;
    if (method !== "GET" && request.headers["x-csrf-token"] !== site.session.csrf) return send(response, 403, { code: "E0903", title: "no proof", status: 403 });
    const answer = handler({ query: url.searchParams, body, at: found.slice(1).map(decodeURIComponent), headers: request.headers });
    return send(response, answer?.status ?? 200, answer);
  }
  return send(response, 404, { code: "E0110", title: "there is nothing at this address", status: 404 });
}

function send(response, status, answer) {
  const problem = status >= 400;
  response.writeHead(status, { "Content-Type": problem ? "application/problem+json" : "application/json" });
  response.end(typeof answer === "string" ? answer : JSON.stringify(answer ?? {}));
}

/** Answers every message with the whole site. */
function socket(request, wire) {
  const key = createHash("sha1").update(`${request.headers["sec-websocket-key"]}258EAFA5-E914-47DA-95CA-C5AB0DC85B11`).digest("base64");
  wire.write(`HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: ${key}\r\n\r\n`);
  wire.on("error", () => wire.destroy());
  wire.on("data", (data) => {
    if ((data[0] & 15) === 8) return wire.end();
    const topics = { "points/#": site.points, modules: site.modules, lines: site.lines };
    for (const [topic, data] of Object.entries(topics)) wire.write(frame(JSON.stringify({ type: "snapshot", topic, seq: 1, data })));
  });
}

function frame(text) {
  const bytes = Buffer.from(text);
  const head = Buffer.from([0x81, 126, bytes.length >> 8, bytes.length & 255]);
  return Buffer.concat([head, bytes]);
}

/** Starts it on a free port, or on the one given. */
export function start(port = 0) {
  const server = createServer((request, response) => {
    const url = new URL(request.url, "http://localhost");
    if (url.pathname.startsWith("/api/v1/")) void api(request, response, url);
    else page(url.pathname, response);
  });
  server.on("upgrade", socket);
  return new Promise((done) =>
    server.listen(port, "127.0.0.1", () => {
      const stop = () => {
        server.closeAllConnections();
        server.close();
      };
      done({ address: `http://127.0.0.1:${server.address().port}`, stop });
    }),
  );
}
