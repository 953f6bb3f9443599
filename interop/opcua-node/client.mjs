// A client of an OPC UA server by node-opcua. Each line on its input is an order in JSON, answered
// by a line: `{"done": …}` or `{"failed": …}`. What subscriptions are told comes in between, as
// `{"told": …}`.

import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { createInterface } from "node:readline";

const say = (line) => process.stdout.write(`${JSON.stringify(line)}\n`);
// What packages say there is none of our lines.
console.log = console.info = console.warn = console.error;

// Only now: what they print as they are loaded is silenced, too.
const ua = await import("node-opcua-client");
const { OPCUACertificateManager } = await import("node-opcua-certificate-manager");

/** The sessions by their names: client, session, and the index of our namespace. */
const sessions = new Map();

/** The certificate that a client of this name has, made where there is none. */
async function identity(pki, called) {
  const manager = new OPCUACertificateManager({
    rootFolder: join(pki, called), automaticallyAcceptUnknownCertificate: true,
    disableFileWatchers: true,
  });
  await manager.initialize();
  return manager;
}

async function client({ url, pki, called = "client", policy = "None" }) {
  const mode = policy === "None" ? "None" : "SignAndEncrypt";
  const made = ua.OPCUAClient.create({
    applicationName: called, clientName: called, endpointMustExist: false,
    clientCertificateManager: await identity(pki, called),
    securityMode: ua.MessageSecurityMode[mode], securityPolicy: ua.SecurityPolicy[policy],
    connectionStrategy: { maxRetry: 0 }, requestedSessionTimeout: 60_000,
  });
  await made.connect(url);
  return made;
}

/** The name of a status, without what it says besides. */
const name = (status) => status?.name.replace(/#.*/, "") ?? "Good";

function plain(value) {
  if (value instanceof Date) return value.getTime();
  if (Array.isArray(value) || ArrayBuffer.isView(value)) return [...value].map(plain);
  if (value && typeof value === "object") {
    if (value instanceof ua.NodeId) return value.toString();
    const own = Object.entries(value).filter(([key]) => !/^[#_]|^schema$/.test(key));
    return Object.fromEntries(own.map(([key, each]) => [key, plain(each)]));
  }
  return value ?? null;
}

function shown(value) {
  return {
    status: name(value.statusCode), value: plain(value.value?.value),
    type: value.value ? ua.DataType[value.value.dataType] : null,
    source: plain(value.sourceTimestamp), server: plain(value.serverTimestamp),
  };
}

const variant = ([type, value]) => new ua.Variant({ dataType: ua.DataType[type], value });

const orders = {
  async endpoints(order) {
    const made = await client(order);
    const found = await made.getEndpoints();
    await made.disconnect();
    return found.map((each) => ({
      policy: each.securityPolicyUri.split("#")[1],
      mode: ua.MessageSecurityMode[each.securityMode],
      users: each.userIdentityTokens.map((token) => ua.UserTokenType[token.tokenType]),
    }));
  },

  /** The thumbprint of a client's certificate. */
  async thumbprint({ pki, called = "client" }) {
    const pem = readFileSync(join(pki, called, "own/certs/client_certificate.pem"), "utf8");
    const der = Buffer.from(pem.replace(/-----[^-]*-----|\s/g, ""), "base64");
    return createHash("sha1").update(der).digest("hex");
  },

  /** A session by a connection of its own, or by that of another session. */
  async connect(order) {
    const made = order.by ? at(order.by).made : await client(order);
    const user = order.user
      ? { type: ua.UserTokenType.UserName, userName: order.user, password: order.password }
      : undefined;
    try {
      const session = await made.createSession(user);
      const namespaces = await session.readNamespaceArray();
      const own = namespaces.indexOf(order.namespace);
      sessions.set(order.as, { made, session, own });
      made.on("connection_lost", () => say({ told: { of: order.as, node: null, lost: true } }));
      return namespaces;
    } catch (error) {
      if (!order.by) await made.disconnect();
      throw error;
    }
  },

  /** Ends a session, and with it its connection and all others by that. */
  async disconnect({ as }) {
    await at(as).made.disconnect();
    sessions.delete(as);
  },

  async browse({ as, node }) {
    const { session, own } = at(as);
    let page = await session.browse({
      nodeId: id(own, node), resultMask: 63, nodeClassMask: 0, includeSubtypes: true,
      browseDirection: ua.BrowseDirection.Forward, referenceTypeId: "References",
    });
    const status = name(page.statusCode);
    const found = [...(page.references ?? [])];
    while (page.continuationPoint?.length) {
      page = await session.browseNext(page.continuationPoint, false);
      found.push(...(page.references ?? []));
    }
    const references = found.map((each) => ({
      node: local(own, each.nodeId),
      name: `${each.browseName.namespaceIndex}:${each.browseName.name}`,
      class: ua.NodeClass[each.nodeClass],
      by: standard(each.referenceTypeId), type: standard(each.typeDefinition),
    }));
    return { status, references };
  },

  async read({ as, nodes, attribute = "Value", times = "Both" }) {
    const { session, own } = at(as);
    const nodesToRead = nodes.map((node) => ({
      nodeId: id(own, node), attributeId: ua.AttributeIds[attribute],
    }));
    const request = new ua.ReadRequest({
      nodesToRead, timestampsToReturn: ua.TimestampsToReturn[times], maxAge: 0,
    });
    const { results } = await session.performMessageTransaction(request);
    return results.map(shown);
  },

  async write({ as, writes }) {
    const { session, own } = at(as);
    const nodesToWrite = writes.map(({ node, attribute = "Value", value, status, source }) => ({
      nodeId: id(own, node), attributeId: ua.AttributeIds[attribute],
      value: {
        value: value ? variant(value) : undefined,
        statusCode: status ? ua.StatusCodes[status] : undefined,
        sourceTimestamp: source ? new Date(source) : undefined,
      },
    }));
    return (await session.write(nodesToWrite)).map(name);
  },

  async call({ as, object, method, values = [] }) {
    const { session, own } = at(as);
    const done = await session.call({
      objectId: id(own, object), methodId: id(own, method), inputArguments: values.map(variant),
    });
    return {
      status: name(done.statusCode), gave: (done.outputArguments ?? []).map((each) => each.value),
      inputs: (done.inputArgumentResults ?? []).map(name),
    };
  },

  async subscribe({ as, called, items, period = 50 }) {
    const { session, own } = at(as);
    const subscription = await session.createSubscription2({
      requestedPublishingInterval: period, requestedMaxKeepAliveCount: 100,
      requestedLifetimeCount: 1_000, publishingEnabled: true,
    });
    const statuses = [];
    for (const { node, filter, interval = -1, queue = 100 } of items) {
      const item = ua.ClientMonitoredItem.create(
        subscription, { nodeId: id(own, node), attributeId: ua.AttributeIds.Value },
        {
          samplingInterval: interval, queueSize: queue, discardOldest: true,
          filter: filter && new ua.DataChangeFilter({
            trigger: ua.DataChangeTrigger[filter], deadbandType: ua.DeadbandType.None,
          }),
        }, ua.TimestampsToReturn.Both,
      );
      item.on("changed", (value) => say({ told: { of: called, node, ...shown(value) } }));
      statuses.push(await new Promise((done) => {
        item.once("initialized", () => done("Good"));
        item.once("err", (message) => done(refusal(message)));
      }));
    }
    return statuses;
  },

  async history({ as, node, from, to, most = 0, bounds = false, pages = 1000 }) {
    const { session, own } = at(as);
    const moment = (time) => new Date(time ?? Date.UTC(1601, 0, 1));
    const historyReadDetails = new ua.ReadRawModifiedDetails({
      isReadModified: false, startTime: moment(from), endTime: moment(to),
      numValuesPerNode: most, returnBounds: bounds,
    });
    const kept = [];
    let [continuationPoint, status] = [null, "Good"];
    for (let page = 0; page < pages; page += 1) {
      const request = new ua.HistoryReadRequest({
        historyReadDetails, timestampsToReturn: ua.TimestampsToReturn.Source,
        nodesToRead: [{ nodeId: id(own, node), continuationPoint }],
      });
      const { results: [result] } = await session.historyRead(request);
      status = name(result.statusCode);
      kept.push((result.historyData?.dataValues ?? []).map(shown));
      continuationPoint = result.continuationPoint;
      if (!continuationPoint?.length) break;
    }
    return { status, pages: kept, goesOn: Boolean(continuationPoint?.length) };
  },
};

/** The status that a message names, or else the message. */
const refusal = (message) => message.match(/Bad[A-Z]\w+/)?.[0] ?? message;

/** A session by its name. */
function at(as) {
  const found = sessions.get(as);
  if (!found) throw new Error(`no session ${as}`);
  return found;
}

/** A node of ours by its name, or of the standard as `i=85`. */
const id = (own, node) => ua.resolveNodeId(/^i=/.test(node) ? node : `ns=${own};s=${node}`);

/** The other way round. */
const local = (own, node) => (node.namespace === own ? node.value : node.toString());

/** What the standard calls a node: `HasComponent`, `FolderType`. */
function standard(node) {
  const known = [ua.ReferenceTypeIds, ua.ObjectTypeIds, ua.VariableTypeIds];
  for (const ids of known) {
    const found = Object.entries(ids).find(([, number]) => number === node.value);
    if (found && node.namespace === 0) return found[0];
  }
  return node.value ? node.toString() : null;
}

for await (const line of createInterface({ input: process.stdin })) {
  const order = JSON.parse(line);
  try {
    say({ done: (await orders[order.do](order)) ?? null });
  } catch (error) {
    // A refusal of the server has the name of its status.
    const status = error.response?.responseHeader?.serviceResult ?? error.statusCode;
    say({ failed: status ? name(status) : refusal(error.message) });
  }
}
process.exit(0);
