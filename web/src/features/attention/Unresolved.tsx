// A command whose outcome nobody knows: what is known of it, and the operator's word on it. It is never
// sent again by itself.

import { useState } from "react";

import type { CommandRecord } from "../../api/types";
import { evidenceOf, FIT_WORDS, heardSince, lastStage } from "../../lib/evidence";
import { readable } from "../../lib/format";
import { formatAge, formatClock, formatSpan, parseOptional } from "../../lib/time";
import { resolve, useRequests } from "../../store/commands";
import { useConsole, useLive } from "../../store/console";
import { wheelOf } from "../../store/kinematics";
import { StatusMark } from "../../ui/StatusMark";
import { VerificationLine } from "../commands/Verification";

export function Unresolved({ command, now_ms }: { command: CommandRecord; now_ms: number }) {
  const [open, setOpen] = useState(false);
  const sent = parseOptional(command.sent);
  return (
    <div className="section stack" data-testid="unresolved" data-command={command.id}>
      <p className="row between">
        <span className="row attention-what">
          <StatusMark status="serious" />
          <strong>{readable(command.title)}: outcome unknown</strong>
        </span>
        {!open && (
          <button
            type="button"
            className="button"
            data-testid="resolve-open"
            onClick={() => setOpen(true)}
          >
            Resolve…
          </button>
        )}
      </p>
      <p className="quiet small">
        Sent by {command.operator}
        {sent !== null && (
          <span className="num">
            {" "}
            {formatClock(sent)}, {formatAge((now_ms - sent) / 1000)} ago
          </span>
        )}
        . It is not sent again by itself.
      </p>
      {open && <Resolve command={command} close={() => setOpen(false)} />}
    </div>
  );
}

function Resolve({ command, close }: { command: CommandRecord; close: () => void }) {
  const [why, setWhy] = useState("");
  const busy = useRequests((s) => s.busy[command.id]);
  const failure = useRequests((s) => s.failures[command.id]);
  const connected = useConsole((s) => s.connection === "open");
  const note = why.trim();
  const off = busy || !connected || note === "";
  const title = note === "" ? "Say first what shows it" : undefined;
  return (
    <>
      <Known command={command} />
      <label className="field">
        What shows it
        <input
          type="text"
          maxLength={500}
          autoFocus
          data-testid="resolve-why"
          placeholder="for example: leg 4 stands where it was to go"
          value={why}
          onChange={(event) => setWhy(event.target.value)}
        />
      </label>
      {failure && (
        <p className="trouble small" role="alert">
          {failure}
        </p>
      )}
      <div className="row between">
        <button type="button" className="button bare" onClick={close}>
          Later
        </button>
        <span className="row">
          <button
            type="button"
            className="button"
            data-testid="resolve-not-done"
            disabled={off}
            title={title}
            onClick={() => void resolve(command.id, false, note)}
          >
            Did not happen
          </button>
          <button
            type="button"
            className="button"
            data-testid="resolve-done"
            disabled={off}
            title={title}
            onClick={() => void resolve(command.id, true, note)}
          >
            Did happen
          </button>
        </span>
      </div>
    </>
  );
}

/** What is known: how far it is verified, what telemetry has come since, and what that fits. */
function Known({ command }: { command: CommandRecord }) {
  const rover = useLive((c) => c.rover);
  const legs = useConsole((s) => s.model?.legs);
  const since_s = heardSince(command, rover?.onboard_ms ?? null);
  const evidence =
    rover && legs && since_s !== null
      ? evidenceOf(command.body, {
          telemetry: rover.message,
          legs,
          wheel: (leg) => wheelOf(leg, rover.message.state),
        })
      : null;
  return (
    <dl className="attention-known small" data-testid="known">
      <div>
        <dt>Verified</dt>
        <dd>{lastStage(command)}</dd>
      </div>
      <VerificationLine command={command} />
      <div>
        <dt>Telemetry</dt>
        <dd data-testid="heard-since">
          {since_s === null
            ? "none since it would have reached the rover; wait for it before you decide"
            : `as of ${formatSpan(since_s)} after it would have reached the rover`}
        </dd>
      </div>
      {evidence && (
        <div>
          <dt>It shows</dt>
          <dd data-testid="evidence" data-fits={evidence.fits}>
            {evidence.text} That {FIT_WORDS[evidence.fits]}.
          </dd>
        </div>
      )}
      {command.step && (
        <div>
          <dt>Steps</dt>
          <dd>
            last told: step {command.step[0]} of {command.step[1]} under way
          </dd>
        </div>
      )}
    </dl>
  );
}
