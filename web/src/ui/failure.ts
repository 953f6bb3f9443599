// What dialogs and toasts show of a failure. A problem of the API has this shape, but `ui` knows no
// type of the API.

export interface Failure {
  code: string;
  title: string;
  /** The title in the language of the page. */
  detail?: string;
  help?: string[];
  /** Commands that may help. */
  hint?: string[];
  may_have_acted?: boolean;
  [more: string]: unknown;
}

/** The reasons of a failure, a sentence each. For a configuration: without the positions in the file. */
export function reasons(failure: Failure): string[] {
  const told = failure["problems"] as { reason?: string }[] | undefined;
  const each = told?.flatMap(({ reason }) => reason ?? []) ?? [];
  return each.length ? each : [failure.detail ?? failure.title];
}
