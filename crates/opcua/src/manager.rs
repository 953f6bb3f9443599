//! What the library asks of us: reads, items to watch, writes, calls and the history.

use crate::items::Items;
use crate::known::{KnownSite, node_id};
use crate::login::{OpcuaUser, OpcuaUsers};
use crate::orders::{self, MethodOrder, ModuleWrite};
use crate::past;
use crate::server::Sync;
use crate::space::{NAMESPACE, SpaceMaker};
use crate::status::OrderEnd;
use async_trait::async_trait;
use opcua::server::address_space::AddressSpace;
use opcua::server::diagnostics::NamespaceMetadata;
use opcua::server::node_manager::memory::{
    InMemoryNodeManager, InMemoryNodeManagerImpl, InMemoryNodeManagerImplBuilder,
};
use opcua::server::node_manager::{
    HistoryNode, MethodCall, MonitoredItemRef, MonitoredItemUpdateRef, ParsedReadValueId,
    RequestContext, ServerContext, WriteNode,
};
use opcua::server::{CreateMonitoredItem, MonitoredItemHandle, SubscriptionCache};
use opcua::sync::RwLock;
use opcua::types::{
    AttributeId, DataValue, DiagnosticBits, DiagnosticInfo, Identifier, MonitoringMode, NodeId,
    StatusCode, TimestampsToReturn, Variant,
};
use railbus_site::{Config, News, Service, WITHIN_MIN, Within};
use railbus_store::audit::Origin;
use railbus_wire::Micros;
use railbus_words::Lang;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore, mpsc, oneshot};
use tokio::task::JoinSet;
use tokio::time::Instant;

/// How many commands may be under way; more are refused.
const COMMANDS_MAX: usize = 64;

/// What all requests share.
pub(crate) struct Shared {
    pub(crate) service: Service,
    pub(crate) users: Arc<dyn OpcuaUsers>,
    /// What the site is called.
    pub(crate) site: String,
    /// What commands come by, as logs have it.
    pub(crate) via: String,
    pub(crate) lang: Lang,
    pub(crate) within: Micros,
    pub(crate) sync: mpsc::Sender<Sync>,
    /// There were so many monitored items that the library has to begin anew.
    pub(crate) is_worn: Notify,
    /// Nothing more is begun.
    pub(crate) has_ended: AtomicBool,
    known: Mutex<KnownSite>,
    items: Mutex<Items>,
    commands: Arc<Semaphore>,
}

/// Who asks for commands with one request, until when they must be sent, and what names stood for
/// when it came.
#[derive(Clone)]
struct Asker {
    identity: String,
    until: Instant,
    since: Arc<Config>,
}

/// What a command of a request gets when its turn has come.
struct Turn {
    service: Service,
    within: Within,
    _permit: OwnedSemaphorePermit,
}

impl Shared {
    pub(crate) fn new(
        (service, users): (Service, Arc<dyn OpcuaUsers>),
        (site, via): (String, String),
        (lang, within): (Lang, Micros),
        sync: mpsc::Sender<Sync>,
        known: KnownSite,
    ) -> Shared {
        Shared {
            service,
            users,
            site,
            via,
            lang,
            within,
            sync,
            is_worn: Notify::new(),
            has_ended: AtomicBool::new(false),
            known: Mutex::new(known),
            items: Mutex::default(),
            commands: Arc::new(Semaphore::new(COMMANDS_MAX)),
        }
    }

    pub(crate) fn known(&self) -> MutexGuard<'_, KnownSite> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn items(&self) -> MutexGuard<'_, Items> {
        self.items.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes over what happened at the site, and tells those who watch it.
    pub(crate) fn take(&self, news: &News, nodes: &SiteNodes, subscriptions: &SubscriptionCache) {
        let told = self.known().take(news);
        if told.is_other {
            nodes.inner().rebuild(&mut nodes.address_space().write());
        }
        let namespace = nodes.inner().namespace;
        let values: Vec<(NodeId, DataValue)> = {
            let known = self.known();
            let value = |name: String| {
                let value = known.value(&name, |_| None);
                (node_id(namespace, &name), value.unwrap_or_else(gone))
            };
            told.changed.into_iter().map(value).collect()
        };
        let mut notifier = subscriptions.data_notifier();
        for (id, value) in values {
            if let Some(mut watched) = notifier.notify_for(&id, AttributeId::Value) {
                let handles: Vec<_> = watched.entries().map(|(handle, _)| *handle).collect();
                for handle in handles {
                    let value = self.items().shaped(handle, value.clone());
                    watched.data_value_to_item(value, &handle);
                }
            }
        }
    }

    /// Who asks, with a request that came now.
    fn asker(&self, context: &RequestContext, since: &Arc<Config>) -> Asker {
        Asker {
            identity: context.user_token().0.clone(),
            until: Instant::now() + Duration::from_micros(self.within.0),
            since: Arc::clone(since),
        }
    }

    /// The turn of a command of a request: in the name of the account as it is now, and not later
    /// than it was meant.
    fn turn(&self, asker: &Asker) -> Result<Turn, StatusCode> {
        if self.has_ended.load(Relaxed) {
            return Err(StatusCode::BadShutdown);
        }
        let user = self.users.user(&asker.identity);
        let user = user.ok_or(StatusCode::BadUserAccessDenied)?;
        let left = asker.until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(StatusCode::BadTimeout);
        }
        let left = u64::try_from(left.as_micros()).unwrap_or(u64::MAX);
        let within = Within::new(Micros(left).max(WITHIN_MIN)).unwrap_or_default();
        let permit = Arc::clone(&self.commands).try_acquire_owned();
        Ok(Turn {
            service: self.service_of(&user),
            within,
            _permit: permit.map_err(|_| StatusCode::BadResourceUnavailable)?,
        })
    }

    /// The user of a request; none where it may not do anything any more.
    fn user(&self, context: &RequestContext) -> Option<OpcuaUser> {
        self.users.user(&context.user_token().0)
    }

    /// The site in the name of a user.
    fn service_of(&self, user: &OpcuaUser) -> Service {
        let origin = Origin {
            who: user.name.clone(),
            via: self.via.clone(),
        };
        self.service.on_behalf_of(origin, user.rights.clone())
    }

    /// Returns when everything that has happened by now is known here.
    async fn synced(&self) {
        let (done, synced) = oneshot::channel();
        if self.sync.send(done).await.is_ok() {
            // Fails if the server stops.
            let _ = synced.await;
        }
    }
}

/// The value of a node that is no more.
fn gone() -> DataValue {
    DataValue {
        status: Some(StatusCode::BadNodeIdUnknown),
        ..DataValue::default()
    }
}

/// Our nodes, in the library's hands.
pub(crate) type SiteNodes = InMemoryNodeManager<SiteManager>;

/// Makes [`SiteManager`] when the library is ready for it.
pub(crate) struct SiteBuilder(pub(crate) Arc<Shared>);

impl InMemoryNodeManagerImplBuilder for SiteBuilder {
    type Impl = SiteManager;

    fn build(self, context: ServerContext, space: &mut AddressSpace) -> SiteManager {
        let namespace = {
            let mut types = context.type_tree.write();
            types.namespaces_mut().add_namespace(NAMESPACE)
        };
        space.add_namespace(NAMESPACE, namespace);
        SiteManager {
            shared: self.0,
            namespace,
            made: Mutex::default(),
        }
    }
}

/// What answers requests about our nodes.
pub(crate) struct SiteManager {
    shared: Arc<Shared>,
    namespace: u16,
    /// The nodes that there are.
    made: Mutex<Vec<NodeId>>,
}

impl SiteManager {
    /// Makes the nodes of the site as it is known now, in place of those before.
    fn rebuild(&self, space: &mut AddressSpace) {
        let mut made = self.made.lock().unwrap_or_else(PoisonError::into_inner);
        for id in made.drain(..) {
            space.delete(&id, true);
        }
        let mut maker = SpaceMaker {
            space,
            namespace: self.namespace,
            lang: self.shared.lang,
            has_history: self.shared.service.history().is_some(),
            made: Vec::new(),
        };
        maker.site(&self.shared.known(), &self.shared.site);
        *made = maker.made;
    }

    /// The value of a node that changes; none where it is a fixed one.
    fn value(&self, id: &NodeId) -> Option<DataValue> {
        let name = self.name(id)?;
        let service = &self.shared.service;
        self.shared.known().value(name, |told| {
            let (module, point) = (&told.module, told.point);
            let now = service.point(module, point)?;
            // Only where it says the same: a change is about to be reported.
            let is_same = now.value == told.value && now.quality == told.quality;
            now.time.filter(|_| is_same)
        })
    }

    /// The name of a node of ours.
    fn name<'n>(&self, id: &'n NodeId) -> Option<&'n str> {
        match &id.identifier {
            Identifier::String(name) if id.namespace == self.namespace => Some(name.as_ref()),
            _ => None,
        }
    }

    /// Carries out the writes to one module, one after the other.
    async fn carry_out(
        shared: Arc<Shared>,
        asker: Asker,
        writes: Vec<ModuleWrite>,
    ) -> Vec<(Vec<usize>, OrderEnd)> {
        let mut ends = Vec::new();
        for write in writes {
            let end = match shared.turn(&asker) {
                Ok(turn) => orders::write(&turn.service, &asker.since, &write, turn.within).await,
                Err(status) => OrderEnd::refused(status),
            };
            ends.push((write.places, end));
        }
        ends
    }

    /// Tells items their present value once more, whatever the library takes for the last one.
    fn refresh(&self, context: &RequestContext, items: &[(MonitoredItemHandle, &NodeId)]) {
        {
            let mut notifier = context.subscriptions.data_notifier();
            for (handle, id) in items {
                let Some(mut watched) = notifier.notify_for(*id, AttributeId::Value) else {
                    continue;
                };
                // Fixed nodes have none that changes.
                if let Some(value) = self.value(id) {
                    let value = self.shared.items().shaped(*handle, value);
                    watched.data_value_to_item(value, handle);
                }
            }
        }
        let session = context.session_id();
        if let Some(subscriptions) = context.subscriptions.get_session_subscriptions(session) {
            let mut subscriptions = subscriptions.lock();
            for (handle, _) in items {
                if let Some(subscription) = subscriptions.get_mut(handle.subscription_id) {
                    subscription.set_resend_data();
                }
            }
        }
    }

    /// The module and the method of a call.
    fn method<'c>(&self, call: &'c MethodCall) -> Option<(&'c str, &'c str)> {
        let module = self.name(call.object_id())?;
        let method = self.name(call.method_id())?;
        let method = method.strip_prefix(module)?.strip_prefix('/')?;
        Some((module, method))
    }

    async fn call_one(&self, asker: &Asker, call: &MethodCall) -> CallEnd {
        let Some((module, method)) = self.method(call) else {
            return CallEnd::Ended(OrderEnd::refused(StatusCode::BadMethodInvalid));
        };
        let order: MethodOrder = match orders::order(method, call.arguments()) {
            Ok(order) => order,
            Err(why) if why.is_empty() => {
                return CallEnd::Ended(OrderEnd::refused(StatusCode::BadArgumentsMissing));
            }
            Err(why) => return CallEnd::WrongArguments(why),
        };
        let turn = match self.shared.turn(asker) {
            Ok(turn) => turn,
            Err(status) => return CallEnd::Ended(OrderEnd::refused(status)),
        };
        // What the name stood for may be another board by now.
        if !Arc::ptr_eq(&turn.service.config(), &asker.since) {
            return CallEnd::Ended(OrderEnd::refused(StatusCode::BadOutOfService));
        }
        let end = orders::call(&turn.service, module, order, turn.within).await;
        CallEnd::Ended(end)
    }
}

/// How a call ended.
enum CallEnd {
    Ended(OrderEnd),
    /// What is wrong with each argument.
    WrongArguments(Vec<StatusCode>),
}

/// The code of an error, for a client that asked for more than a status.
fn diagnostics(bits: DiagnosticBits, end: &OrderEnd) -> Option<DiagnosticInfo> {
    let is_asked = bits.contains(DiagnosticBits::OPERATIONAL_LEVEL_ADDITIONAL_INFO);
    (is_asked && !end.code.is_empty()).then(|| DiagnosticInfo {
        additional_info: Some(end.code.as_str().into()),
        ..DiagnosticInfo::default()
    })
}

#[async_trait]
impl InMemoryNodeManagerImpl for SiteManager {
    async fn init(&self, space: &mut AddressSpace, _: ServerContext) {
        self.rebuild(space);
    }

    fn name(&self) -> &str {
        "railbus"
    }

    fn namespaces(&self) -> Vec<NamespaceMetadata> {
        vec![NamespaceMetadata {
            namespace_uri: NAMESPACE.to_owned(),
            namespace_index: self.namespace,
            ..NamespaceMetadata::default()
        }]
    }

    async fn read_values(
        &self,
        context: &RequestContext,
        space: &RwLock<AddressSpace>,
        nodes: &[&ParsedReadValueId],
        max_age: f64,
        times: TimestampsToReturn,
    ) -> Vec<DataValue> {
        let may_read = self.shared.user(context).is_some();
        let space = space.read();
        let read = |node: &&ParsedReadValueId| {
            if !may_read {
                return DataValue {
                    status: Some(StatusCode::BadUserAccessDenied),
                    ..DataValue::default()
                };
            }
            let fixed = space.read(context, node, max_age, times);
            let is_read = fixed.status.is_none_or(|status| status.is_good());
            match is_read.then(|| self.value(&node.node_id)).flatten() {
                Some(value) => with_times(value, times),
                None => fixed,
            }
        };
        nodes.iter().map(read).collect()
    }

    async fn create_value_monitored_items(
        &self,
        context: &RequestContext,
        space: &RwLock<AddressSpace>,
        items: &mut [&mut &mut CreateMonitoredItem],
    ) {
        // The read never waits: until the library has the items nothing is reported in between.
        let asked: Vec<_> = items
            .iter()
            .map(|item| item.item_to_monitor().clone())
            .collect();
        let asked: Vec<_> = asked.iter().collect();
        let both = TimestampsToReturn::Both;
        let values = self.read_values(context, space, &asked, 0.0, both).await;
        for (item, value) in items.iter_mut().zip(values) {
            match value.status {
                Some(
                    status @ (StatusCode::BadNodeIdUnknown
                    | StatusCode::BadAttributeIdInvalid
                    | StatusCode::BadUserAccessDenied),
                ) => item.set_status(status),
                _ => self.shared.items().created(item, value),
            }
        }
        if self.shared.items().are_too_many() {
            self.shared.is_worn.notify_one();
        }
    }

    async fn set_monitoring_mode(
        &self,
        context: &RequestContext,
        mode: MonitoringMode,
        items: &[&MonitoredItemRef],
    ) {
        // While it was disabled, nothing was reported.
        if mode != MonitoringMode::Disabled {
            let items: Vec<_> = items
                .iter()
                .map(|item| (item.handle(), item.node_id()))
                .collect();
            self.refresh(context, &items);
        }
    }

    async fn modify_monitored_items(
        &self,
        context: &RequestContext,
        items: &[&MonitoredItemUpdateRef],
    ) {
        for item in items {
            self.shared.items().modified(item.handle());
        }
        // A shorter queue may have lost its newest value.
        let items: Vec<_> = items
            .iter()
            .map(|item| (item.handle(), item.node_id()))
            .collect();
        self.refresh(context, &items);
    }

    async fn delete_monitored_items(&self, _: &RequestContext, items: &[&MonitoredItemRef]) {
        for item in items {
            self.shared.items().deleted(item.handle());
        }
    }

    async fn write(
        &self,
        context: &RequestContext,
        space: &RwLock<AddressSpace>,
        nodes: &mut [&mut WriteNode],
    ) -> Result<(), StatusCode> {
        let Some(user) = self.shared.user(context) else {
            return Err(StatusCode::BadUserAccessDenied);
        };
        let mut outputs = Vec::new();
        // What the names stand for now is what is meant, also where a reload comes between.
        let since = {
            let (space, known) = (space.read(), self.shared.known());
            for (place, node) in nodes.iter_mut().enumerate() {
                if !space.node_exists(&node.value().node_id) {
                    node.set_status(StatusCode::BadNodeIdUnknown);
                    continue;
                }
                let name = self.name(&node.value().node_id);
                match orders::asked(&known, &user, name, node.value()) {
                    Ok(output) => outputs.push((place, output)),
                    Err(status) => node.set_status(status),
                }
            }
            Arc::clone(known.config())
        };
        if outputs.is_empty() {
            return Ok(());
        }
        // What is begun goes on also where the client goes.
        let mut commands = JoinSet::new();
        let asker = self.shared.asker(context, &since);
        for writes in orders::commands(outputs) {
            let shared = Arc::clone(&self.shared);
            commands.spawn(Self::carry_out(shared, asker.clone(), writes));
        }
        let ends = commands.join_all().await;
        self.shared.synced().await;
        for (places, end) in ends.into_iter().flatten() {
            for place in places {
                if let Some(node) = nodes.get_mut(place) {
                    if let Some(more) = diagnostics(node.diagnostic_bits(), &end) {
                        node.set_diagnostic_info(more);
                    }
                    node.set_status(end.status);
                }
            }
        }
        Ok(())
    }

    async fn call(
        &self,
        context: &RequestContext,
        _: &RwLock<AddressSpace>,
        calls: &mut [&mut &mut MethodCall],
    ) -> Result<(), StatusCode> {
        let since = Arc::clone(self.shared.known().config());
        let asker = self.shared.asker(context, &since);
        for call in calls {
            match self.call_one(&asker, call).await {
                CallEnd::Ended(end) => {
                    if let Some(more) = diagnostics(call.diagnostic_bits(), &end) {
                        call.set_diagnostic_info(more);
                    }
                    if !end.status.is_bad() {
                        let outputs = [end.end, &end.code, &end.audit];
                        call.set_outputs(outputs.map(Variant::from).into());
                    }
                    call.set_status(end.status);
                }
                CallEnd::WrongArguments(why) => call.set_argument_error(why),
            }
        }
        self.shared.synced().await;
        Ok(())
    }

    async fn history_read_raw_modified(
        &self,
        context: &RequestContext,
        details: &opcua::types::ReadRawModifiedDetails,
        nodes: &mut [&mut &mut HistoryNode],
        times: TimestampsToReturn,
    ) -> Result<(), StatusCode> {
        if self.shared.user(context).is_none() {
            return Err(StatusCode::BadUserAccessDenied);
        }
        let span = past::span(details, times)?;
        let Some(history) = self.shared.service.history() else {
            return Err(StatusCode::BadHistoryOperationUnsupported);
        };
        for node in nodes {
            let point = self.name(node.node_id()).and_then(|name| {
                let known = self.shared.known();
                let kind = known.point(name).map(|status| status.point.kind)?;
                Some((name.to_owned(), kind))
            });
            match point {
                Some((path, kind)) => {
                    let asked = (span, details.return_bounds);
                    past::read(history, node, (&path, kind), asked, times).await;
                }
                None => node.set_status(StatusCode::BadHistoryOperationUnsupported),
            }
        }
        Ok(())
    }
}

/// Only the times that a client wants.
fn with_times(mut value: DataValue, times: TimestampsToReturn) -> DataValue {
    past::with_times(&mut value, times);
    value
}
