// The door's questions: who calls, how a refusal looks to a gRPC client, and the emergency stop.
//
// palpate-door keeps a file for each caller, so that one who is revoked is refused from the next
// call on, without a new start:
//   callers/token-SHA256, callers/salted-SALT-SHA256, callers/certificate-SHA256 of the name
// Its text: {"name": "ada", "role": "viewer", "expires_s": 1800000000}; expires_s is optional.

import crypto from 'crypto';
import fs from 'fs';

const CALLERS = 'callers/';
const ROLES = ['viewer', 'editor', 'operator', 'admin'];
const ASK = ": ask the operator for a new one ('palpate-door add')";
const LONGEST_TOKEN = 128;

function hash(text) {
  return crypto.createHash('sha256').update(text).digest('hex');
}

function caller(file) {
  try {
    return JSON.parse(fs.readFileSync(CALLERS + file, 'utf8'));
  } catch (e) {
    return null;
  }
}

// palpated's own tokens of before, which `palpate-door import` took over, have a salt each.
function byToken(token) {
  const found = caller('token-' + hash(token));
  if (found) return found;
  const salted = fs.readdirSync(CALLERS).filter((file) => file.startsWith('salted-'));
  for (let i = 0; i < salted.length; ++i) {
    const part = salted[i].split('-');
    if (hash(part[1] + token) === part[2]) return caller(salted[i]);
  }
  return null;
}

// The names in a certificate that nginx has verified: mail addresses, DNS names and URIs of its
// subjectAltName (RFC 5280, 4.2.1.6).
function namesOf(pem) {
  const der = Buffer.from(pem.replace(/-----[A-Z ]+-----|\s/g, ''), 'base64');
  // An element of ASN.1's DER: its tag, and where its content begins and ends.
  function element(at) {
    let length = der[at + 1], begin = at + 2;
    if (length > 127) {
      const bytes = length & 127;
      length = der.readUIntBE(begin, bytes);
      begin += bytes;
    }
    return {tag: der[at], begin, end: begin + length};
  }
  function inside(one) {
    const found = [];
    for (let at = one.begin; at < one.end; at = found[found.length - 1].end) found.push(element(at));
    return found;
  }
  const text = (one) => der.slice(one.begin, one.end).toString();
  const extensions = inside(inside(element(0))[0]).find((one) => one.tag === 0xa3);
  if (!extensions) return [];
  const wanted = inside(inside(extensions)[0]).map(inside)
      .find((parts) => der.slice(parts[0].begin, parts[0].end).toString('hex') === '551d11');
  if (!wanted) return [];
  const names = inside(element(wanted[wanted.length - 1].begin));
  return names.filter((one) => [0x81, 0x82, 0x86].includes(one.tag)).map(text);
}

function byCertificate(pem) {
  let best = null;
  namesOf(pem).forEach((name) => {
    const found = caller('certificate-' + hash(name));
    if (found && (!best || ROLES.indexOf(found.role) > ROLES.indexOf(best.role))) best = found;
  });
  return best;
}

// Sets who calls and with which role, or the problem.
function judge(r) {
  const given = r.headersIn.authorization;
  const kind = given ? 'token' : 'certificate';
  let found = null, problem = '';
  if (given) {
    const token = given.startsWith('Bearer ') ? given.slice(7) : '';
    const mayBe = token.startsWith('palpate_') && token.length <= LONGEST_TOKEN;
    found = mayBe ? byToken(token) : null;
    problem = 'its token is unknown, or was revoked' + ASK;
  } else if (r.variables.ssl_client_verify === 'SUCCESS') {
    found = byCertificate(r.variables.ssl_client_raw_cert);
    problem = 'no name of its certificate has a role: palpate-door add NAME --certificate';
  } else {
    problem = 'neither a token nor a certificate came: give one of them';
  }
  if (found && found.expires_s && Date.now() / 1000 >= found.expires_s) {
    found = null;
    problem = 'its ' + kind + ' expired' + ASK;
  }
  if (!found || !ROLES.includes(found.role)) {
    r.variables.palpate_problem = problem;
    return '';
  }
  r.variables.palpate_role = found.role;
  return kind + ' ' + found.name;
}

// As gRPC names it, so that palpated knows what is address and what is port.
function address(r) {
  const from = r.remoteAddress, is6 = from.includes(':');
  return (is6 ? 'ipv6:%5B' + from + '%5D' : 'ipv4:' + from) + ':' + r.variables.remote_port;
}

const STATUS = {
  400: [3, 'the request is malformed'],
  401: [16, ''],
  404: [12, 'palpated has no such method'],
  413: [8, 'the request is too large'],
  429: [8, 'too many calls at once, or in a second: wait'],
  495: [16, 'its certificate is refused'],
  502: [14, 'palpated does not answer: is it running?'],
  504: [14, 'palpated does not answer in time'],
};

// Every refusal, as gRPC wants it: HTTP's 200, and gRPC's status in the header.
function refuse(r) {
  let status = Number(r.uri.slice('/.refuse/'.length));
  // nginx takes one token alone: nobody knows which of two is meant.
  if (status === 400 && r.headersIn.authorization) status = 401;
  const known = STATUS[status] || [13, 'HTTP ' + status];
  let problem = known[1] || r.variables.palpate_problem || 'its token came twice';
  if (status === 495) problem += ' (' + r.variables.ssl_client_verify + ')';
  const path = r.variables.request_uri.slice(0, 100);
  const method = path.slice(path.lastIndexOf('/') + 1);
  const who = r.variables.palpate_caller || 'a stranger';
  r.warn('refused ' + who + ' at ' + address(r) + ' to call ' + path + ': ' + problem);
  r.headersOut['content-type'] = 'application/grpc';
  r.headersOut['grpc-status'] = known[0];
  r.headersOut['grpc-message'] = encodeURI('the door refuses ' + method + ': ' + problem);
  r.return(200);
}

function varint(number) {
  const bytes = [];
  for (; number > 127; number = Math.floor(number / 128)) bytes.push(number % 128 + 128);
  bytes.push(number);
  return Buffer.from(bytes);
}

function double(number) {
  const bytes = Buffer.alloc(8);
  bytes.writeDoubleLE(number, 0);
  return bytes;
}

// A field of protobuf: 0 a number, 1 a double, 2 bytes.
function field(number, wire, content) {
  const parts = [varint(number * 8 + wire), content];
  if (wire === 2) parts.splice(1, 0, varint(content.length));
  return Buffer.concat(parts);
}

// The stop's socket answers with a line of numbers (server/stop/stop_door.h). The client expects
// StopForcesResponse (proto/palpate/v1/device.proto).
async function stop(r) {
  const reply = await r.subrequest('/.stop');
  const said = (reply.responseText || '').trim().split(' ');
  const state = Number(said[0]), tick = Number(said[2]);
  r.headersOut['content-type'] = 'application/grpc';
  if (reply.status !== 200 || !(state > 0)) {
    r.variables.palpate_stop_status = 14;
    r.variables.palpate_stop_message = encodeURI(
        said[0] === 'waits' ? 'the haptic loop did not tick: the stop acts in its next tick'
                            : 'palpated does not answer: is it running?');
    return r.return(200);
  }
  const forces = Buffer.concat([
    field(1, 0, varint(state)), field(2, 0, varint(Number(said[1]))),
    field(3, 1, double(Number(said[3]))), field(4, 1, double(Number(said[4])))]);
  const message = Buffer.concat([field(1, 2, forces), field(2, 0, varint(tick))]);
  r.variables.palpate_stop_status = 0;
  r.return(200, Buffer.concat([Buffer.from([0, 0, 0, 0, message.length]), message]));
}

export default {judge, address, refuse, stop};
