// The client of the daemon's API. A request that fails throws an `ApiError` with its problem.
import { farSite, hrefOf } from "./base";
import { language, t } from "../i18n/index.svelte";
import type { Problem } from "./types";

const BASE = "/api/v1";
/** The API of a centre, whose routes are given with it. */
const FLEET = "/fleet/v1";
/** How long a request may take before it is aborted; a centre itself waits 25 s for a site. */
const TIMEOUT_MS = farSite === null ? 15_000 : 30_000;

export class ApiError extends Error {
  constructor(readonly problem: Problem) {
    super(problem.detail ?? problem.title);
  }
}

/** The session's CSRF token, sent with every write. */
let csrf: string | null = null;
/** Called when the session has ended. */
let ended: () => void = () => {};

export function setCsrfToken(token: string | null): void {
  csrf = token;
}

export function csrfToken(): string | null {
  return csrf;
}

/** Called whenever the daemon has answered. */
let reached: () => void = () => {};

export function onResponse(then: () => void): void {
  reached = then;
}

export function onSessionEnd(then: () => void): void {
  ended = then;
}

/** The address of a route. */
export const routeUrl = (path: string): string => (path.startsWith(`${FLEET}/`) ? path : hrefOf(BASE + path));

async function request(
  method: string,
  path: string,
  body?: unknown,
  more?: HeadersInit,
  timeout = TIMEOUT_MS,
): Promise<Response> {
  const headers = new Headers(more);
  headers.set("Accept-Language", language());
  if (body !== undefined) headers.set("Content-Type", "application/json");
  if (csrf && method !== "GET") headers.set("X-CSRF-Token", csrf);
  const init: RequestInit = { method, headers, signal: AbortSignal.timeout(timeout) };
  if (body !== undefined) init.body = JSON.stringify(body);
  let response: Response;
  try {
    response = await fetch(routeUrl(path), init);
  } catch {
    throw new ApiError({ code: "", title: t("no_daemon"), status: 0 });
  }
  reached();
  if (response.ok) return response;
  const problem = await problemIn(response);
  if (response.status === 401 && path !== "/login" && !response.headers.has(OF_SITE)) ended();
  throw new ApiError(problem);
}

/** Only answers of a far site have it, not those of its centre. */
const OF_SITE = "railbus-transit-ms";
/** A right that is missing. What is missing at a far site is granted there, to its centre. */
const NO_RIGHT = ["E0905", "E0906", "E0941"];

async function problemIn(response: Response): Promise<Problem> {
  try {
    const problem = (await response.json()) as Problem;
    return response.headers.has(OF_SITE) && NO_RIGHT.includes(problem.code) ? { ...problem, help: [t("far_grants")] } : problem;
  } catch {
    const { status } = response;
    return { code: "", title: t("failed", { status }), status };
  }
}

async function json<T>(response: Promise<Response>): Promise<T> {
  const answer = await response;
  return (answer.status === 204 ? undefined : await answer.json()) as T;
}

export const get = <T>(path: string, timeout?: number): Promise<T> => json(request("GET", path, undefined, undefined, timeout));
export const put = <T>(path: string, body?: unknown, more?: HeadersInit): Promise<T> =>
  json(request("PUT", path, body, more));
/** `longer`: milliseconds added to the usual timeout. */
export const post = <T>(path: string, body?: unknown, longer = 0, more?: HeadersInit): Promise<T> =>
  json(request("POST", path, body, more, TIMEOUT_MS + longer));
export const patch = <T>(path: string, body: unknown, more?: HeadersInit): Promise<T> =>
  json(request("PATCH", path, body, more));
export const remove = <T>(path: string): Promise<T> => json(request("DELETE", path));

/** The problem behind whatever was thrown. */
export function problemOf(thrown: unknown): Problem {
  if (thrown instanceof ApiError) return thrown.problem;
  if (thrown && typeof thrown === "object" && "code" in thrown && "title" in thrown) return thrown as Problem;
  return { code: "", title: String(thrown), status: 500 };
}
