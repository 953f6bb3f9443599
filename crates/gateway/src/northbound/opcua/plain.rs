//! What may be asked over a channel without encryption from another machine: which endpoints there
//! are, and nothing else.
//!
//! The library looks at the policy of a channel when a session is to be used. It would create
//! sessions before, for everybody, until there are no more.

/// The policy of a channel without encryption [OPC UA part 7, 6.6.165].
const NONE: &[u8] = b"http://opcfoundation.org/UA/SecurityPolicy#None";
/// The header of a message: three letters for what it is, one for whether it is whole, and its
/// length [OPC UA part 6, 7.1.2.2].
const HEADER: usize = 8;
/// Where the policy stands in a message that opens a channel: after the channel's number.
const POLICY: usize = HEADER + 4;
/// Where the type of a request stands: after the numbers of channel, token, message and request.
const REQUEST: usize = HEADER + 16;
/// The longest beginning of a message that is looked at.
const LOOKED_MAX: usize = POLICY + 4 + 256;
/// FindServers, GetEndpoints and FindServersOnNetwork, in their binary form [OPC UA part 6, A.3].
const ALLOWED: [u32; 3] = [422, 428, 12_208];

/// What a client has sent so far, as far as it says what may come.
#[derive(Debug, Default)]
pub(super) struct ClientChannel {
    /// The beginning of the present message.
    head: Vec<u8>,
    /// How much of it is to come; none until its header is there.
    left: Option<usize>,
    /// It was looked at.
    is_known: bool,
    is_plain: bool,
}

impl ClientChannel {
    /// Whether these bytes, the next ones of the client, may go on.
    pub(super) fn passes(&mut self, mut bytes: &[u8]) -> bool {
        while !bytes.is_empty() {
            let most = match self.left {
                None => HEADER - self.head.len(),
                Some(left) => left,
            };
            let (these, rest) = bytes.split_at(bytes.len().min(most));
            bytes = rest;
            let room = LOOKED_MAX.saturating_sub(self.head.len());
            self.head.extend(these.iter().take(room));
            self.left = match (self.left, length(&self.head)) {
                (Some(left), _) => Some(left - these.len()),
                (None, None) => None,
                (None, Some(len)) => {
                    match usize::try_from(len).map(|len| len.checked_sub(HEADER)) {
                        Ok(Some(left)) => Some(left),
                        _ => return false,
                    }
                }
            };
            let is_whole = self.left == Some(0);
            if !self.is_known && !self.looks_good(is_whole) {
                return false;
            }
            if is_whole {
                self.head.clear();
                (self.left, self.is_known) = (None, false);
            }
        }
        true
    }

    /// Looks at the present message, once enough of it is there.
    fn looks_good(&mut self, is_whole: bool) -> bool {
        let Some((kind, _)) = self.head.split_first_chunk::<4>() else {
            return true;
        };
        match kind {
            b"OPNF" => match policy(&self.head) {
                Some(policy) => {
                    (self.is_known, self.is_plain) = (true, policy == NONE);
                    true
                }
                // Too short to be one, or its policy is longer than any.
                None => !is_whole && self.head.len() < LOOKED_MAX,
            },
            b"MSGF" if self.is_plain => match request(&self.head) {
                Some(request) => {
                    self.is_known = true;
                    ALLOWED.contains(&request)
                }
                None => !is_whole,
            },
            // A request for endpoints fits into one chunk.
            b"MSGC" if self.is_plain => false,
            _ => {
                self.is_known = true;
                true
            }
        }
    }
}

fn length(head: &[u8]) -> Option<u32> {
    let bytes = head.get(4..HEADER)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?))
}

/// The policy in a message that opens a channel.
fn policy(head: &[u8]) -> Option<&[u8]> {
    let (len, rest) = head.get(POLICY..)?.split_first_chunk::<4>()?;
    let len = usize::try_from(u32::from_le_bytes(*len)).ok()?;
    rest.get(..len)
}

/// The type of the request in a message [OPC UA part 6, 5.2.2.9]; 0 where it is none of the
/// standard's numbers.
fn request(head: &[u8]) -> Option<u32> {
    let (form, rest) = head.get(REQUEST..)?.split_first()?;
    match form {
        0 => rest.first().map(|id| u32::from(*id)),
        1 => match rest.first_chunk::<3>()? {
            [0, low, high] => Some(u32::from(u16::from_le_bytes([*low, *high]))),
            _ => Some(0),
        },
        2 => match rest.first_chunk::<6>()? {
            [0, 0, id @ ..] => Some(u32::from_le_bytes(*id)),
            _ => Some(0),
        },
        _ => Some(0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A message of this kind with this behind its header.
    fn message(kind: &[u8; 4], body: &[u8]) -> Vec<u8> {
        let len = u32::try_from(HEADER + body.len()).unwrap();
        [&kind[..], &len.to_le_bytes(), body].concat()
    }

    fn open(policy: &[u8]) -> Vec<u8> {
        let len = u32::try_from(policy.len()).unwrap().to_le_bytes();
        message(b"OPNF", &[&[0; 4][..], &len, policy, &[0xFF; 60]].concat())
    }

    /// A request of this type, in the form that everybody uses.
    fn ask(kind: &[u8; 4], id: u16) -> Vec<u8> {
        let id = id.to_le_bytes();
        message(kind, &[&[7; 16][..], &[1, 0], &id, &[0; 200]].concat())
    }

    /// Whether a client may say this, however it comes.
    fn may_say(said: &[Vec<u8>]) -> bool {
        let said = said.concat();
        let ends = [1, 7, 16, said.len()].map(|size| {
            let mut channel = ClientChannel::default();
            said.chunks(size).all(|bytes| channel.passes(bytes))
        });
        assert!(ends.iter().all(|end| *end == ends[0]), "{ends:?}");
        ends[0]
    }

    const HELLO: [u8; 4] = *b"HELF";
    const CREATE_SESSION: u16 = 461;
    const GET_ENDPOINTS: u16 = 428;

    #[test]
    fn without_encryption_only_endpoints_are_asked_for() {
        let hello = message(&HELLO, &[0; 40]);
        let plain = || vec![hello.clone(), open(NONE)];
        let and = |mut said: Vec<Vec<u8>>, more: Vec<u8>| {
            said.push(more);
            said
        };
        assert!(may_say(&and(plain(), ask(b"MSGF", GET_ENDPOINTS))));
        assert!(!may_say(&and(plain(), ask(b"MSGF", CREATE_SESSION))));
        let asked = and(plain(), ask(b"MSGF", GET_ENDPOINTS));
        assert!(!may_say(&and(asked, ask(b"MSGF", CREATE_SESSION))), "later");
        assert!(
            !may_say(&and(plain(), ask(b"MSGC", GET_ENDPOINTS))),
            "pieces"
        );
        assert!(may_say(&and(plain(), message(b"CLOF", &[0; 30]))));
        // The same number in the longer form.
        let id = u32::from(CREATE_SESSION).to_le_bytes();
        let long = message(b"MSGF", &[&[7; 16][..], &[2, 0, 0], &id, &[0; 50]].concat());
        assert!(!may_say(&and(plain(), long)));
        let cut = message(b"MSGF", &[7; 16]);
        assert!(!may_say(&and(plain(), cut)), "no request at all");
    }

    #[test]
    fn with_encryption_nothing_is_looked_at() {
        let policy = b"http://opcfoundation.org/UA/SecurityPolicy#Basic256Sha256";
        let said = [
            open(policy),
            ask(b"MSGC", 0xFFFF),
            ask(b"MSGF", CREATE_SESSION),
        ];
        assert!(may_say(&said));
        // A channel that is opened anew is as it is then.
        let back = [open(policy), open(NONE), ask(b"MSGF", CREATE_SESSION)];
        assert!(!may_say(&back));
    }

    #[test]
    fn what_is_no_message_ends_it() {
        assert!(
            !may_say(&[b"MSGF\x07\0\0\0".to_vec()]),
            "shorter than its header"
        );
        let huge = [
            b"OPNF\xFF\xFF\xFF\x7F\0\0\0\0\xFF\xFF\xFF\x7F".to_vec(),
            vec![0; 400],
        ];
        assert!(!may_say(&huge), "a policy without end");
    }
}
