// The types of the API, under the names that the pages use. They are generated from the OpenAPI
// document of the program (`npm run types`, docs/decisions/0032); a build only erases them.
import type { Names } from "../i18n/index.svelte";
import type { components as OfCentre } from "../../generated/fleet";
import type { components } from "../../generated/openapi";

type Schemas = components["schemas"];
type FleetSchemas = OfCentre["schemas"];

export type ActionText = Schemas["ActionText"];
export type AuditEntry = Schemas["AuditInfo"];
export type BatchAnswer = Schemas["BatchAnswer"];
export type EventKind = Schemas["EventKind"];
export type FleetBulk = FleetSchemas["FleetBulk"];
export type FleetBulkPreview = FleetSchemas["FleetBulkPreview"];
export type FleetBulkSites = FleetSchemas["FleetBulkSites"];
export type FleetBulkState = FleetSchemas["FleetBulkState"];
export type FleetCommand = FleetSchemas["FleetCommand"];
export type FleetCommandEnd = FleetSchemas["FleetCommandEnd"];
export type FleetConfig = FleetSchemas["FleetConfig"];
export type FleetConfigState = FleetSchemas["FleetConfigState"];
export type FleetConfigText = FleetSchemas["FleetConfigText"];
export type FleetCommands = FleetSchemas["FleetCommands"];
export type FleetPoint = FleetSchemas["FleetPoint"];
export type FleetSite = FleetSchemas["FleetSite"];
export type FleetSitePoints = FleetSchemas["FleetSitePoints"];
export type FleetSites = FleetSchemas["FleetSites"];
export type Found = Schemas["ScanModule"];
export type GroupInfo = Schemas["GroupInfo"];
export type HistoryInfo = Schemas["HistoryInfo"];
export type LineInfo = Schemas["LineInfo"];
export type LoadInfo = Schemas["LoadInfo"];
export type LoggedChange = Schemas["LoggedChange"];
export type ModuleInfo = Schemas["ModuleInfo"];
export type ModelSheet = Schemas["ModelInfo"];
export type Operation = Schemas["OpInfo"];
export type Outlet = Schemas["OutletInfo"];
export type OutletField = Schemas["OutletField"];
export type OutletKind = Schemas["OutletKindInfo"];
export type OutletMap = Schemas["OutletMap"];
export type OutletTest = Schemas["OutletTest"];
export type RegisterRead = Schemas["RegisterRead"];
export type Role = Schemas["Role"];
export type Rule = Schemas["RuleInfo"];
export type ScanRequest = Schemas["ScanRequest"];
export type SceneInfo = Schemas["SceneInfo"];
export type SendAnswer = Schemas["SendAnswer"];
export type SendPlan = Schemas["SendPlan"];
export type Session = Schemas["SessionTold"];
export type SessionInfo = Schemas["SessionInfo"];
export type Setting = Schemas["Setting"];
export type Settings = Schemas["Settings"];
export type SettingsPlan = Schemas["SettingsPlan"];
export type SimFaultInfo = Schemas["SimFaultInfo"];
export type SimLineInfo = Schemas["SimLineInfo"];
export type SimModuleInfo = Schemas["SimModuleInfo"];
export type SimPointInfo = Schemas["SimPointInfo"];
export type SiteEvent = Schemas["EventInfo"];
export type StepText = Schemas["StepText"];
export type StorageInfo = Schemas["StorageInfo"];
export type SystemInfo = Schemas["SystemInfo"];
export type TokenInfo = Schemas["TokenInfo"];
export type TriedInfo = Schemas["TriedInfo"];
export type UserInfo = Schemas["UserInfo"];
export type VerifiedInfo = Schemas["VerifiedInfo"];
export type WhenText = Schemas["WhenText"];
export type Written = Schemas["Written"];

/** A point, and when it was read by the clock of this browser. */
export type PointInfo = Schemas["PointInfo"] & { read_at?: number };

/** Why something was not done [RFC 9457], in the language of the request. */
export type Problem = Schemas["Problem"] & { detail?: string; help?: string[] };

/** A page of a list. */
export interface Page<T> {
  items: T[];
  next: string | null;
}

/** A group or a scene, as it is edited. */
export interface GroupOrScene {
  id: string;
  name?: Names;
  steps: StepText[];
}
