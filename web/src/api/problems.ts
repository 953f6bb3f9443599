// Problems of the API, shown as failures.
import { dismissFailures, showFailure } from "../ui/toasts.svelte";
import { onResponse, problemOf } from "./client";

/** Shows why something failed, and for a command the state of the output now. */
export function showProblem(thrown: unknown, verdict?: string): void {
  showFailure(problemOf(thrown), verdict);
}

// "The daemon does not answer" is dismissed when it does.
onResponse(() => dismissFailures((failure) => failure["status"] === 0));
