// The story of the step in one line, and the only place from which anything is sent.

import { Check, Send } from "lucide-react";
import { useEffect, useRef } from "react";

import type { CommandRecord } from "../../api/types";
import { commandClock, isOpen, isUnderWay } from "../../lib/commandClock";
import { legLabel, readable } from "../../lib/format";
import { planProgress } from "../../lib/planProgress";
import { type Stage, STAGES, type Step, stepOf } from "../../lib/step";
import { formatSpan } from "../../lib/time";
import { commandName, sendArmed, takeBack, useRequests } from "../../store/commands";
import { useLive } from "../../store/console";
import { useServerNow } from "../../store/now";
import { useArmBlocked, useBlocked } from "../../store/permission";
import { usePlan } from "../../store/plan";
import { useSelection } from "../../store/selection";
import { type RightTab, useView } from "../../store/view";
import { Ring } from "../../ui/Ring";
import "./step-strip.css";

function useStep(): { step: Step; armed: CommandRecord | null; now: number } {
  const now = useServerNow();
  const leg = useSelection((s) => s.leg);
  const picked = useSelection((s) => s.pick !== null);
  const job = usePlan((s) => s.job);
  const plan = usePlan((s) => s.plan);
  const all = useLive((c) => c.commands);
  const progress = plan && planProgress(plan, all);
  const byHand =
    all.findLast(
      (c) => !c.plan && c.state !== "overdue" && (isOpen(c.state) || isUnderWay(c.state)),
    ) ?? null;
  const armed =
    all.findLast((c) => c.state === "armed" && commandClock(c, now).armed_s !== 0) ?? null;
  return { step: stepOf({ leg, picked, job, plan, progress, byHand, now_ms: now }), armed, now };
}

export function StepStrip() {
  const { step: asked, armed, now } = useStep();
  const nothing = useBlocked();
  const noCommand = useArmBlocked();
  // Planning takes no authority to command; arming and sending do.
  const blocked = asked.stage === "arm" || asked.stage === "send" ? noCommand : nothing;
  // Nothing is asked of the operator that the console would then refuse.
  const step = asked.yours && blocked ? { ...asked, trouble: true, sentence: blocked } : asked;
  const at = STAGES.indexOf(step.stage);
  return (
    <section className="strip" aria-label="The step">
      <ol className="stages">
        {STAGES.map((stage, i) => (
          <li
            key={stage}
            className={i < at ? "stage past" : i === at ? "stage now" : "stage"}
            aria-current={i === at ? "step" : undefined}
          >
            <i aria-hidden>{i < at && <Check size={10} strokeWidth={3} />}</i>
            {stage}
          </li>
        ))}
      </ol>
      <div className="strip-say" data-testid="step" data-stage={step.stage}>
        <p className={step.trouble ? "trouble" : ""}>{readable(step.sentence)}</p>
        {/* The sentence counts down; only where the step stands is read out. */}
        <span className="sr" aria-live="polite">
          {[step.stage, step.command].filter(Boolean).join(": ")}
        </span>
        {step.share !== null && !step.yours && (
          <div className="bar strip-bar">
            <span style={{ width: `${(100 * step.share).toFixed(1)}%` }} />
          </div>
        )}
      </div>
      {!armed && step.yours && !blocked && <WayToAct stage={step.stage} />}
      {armed && <SendArmed key={armed.id} command={armed} now={now} />}
    </section>
  );
}

/** Stages whose control is in a panel; that of sending is in the strip itself. */
const IN_A_PANEL: Stage[] = ["plan", "check", "arm"];

/** Where the panel with the next control is not open, the way to it. */
function WayToAct({ stage }: { stage: Stage }) {
  const { tab, rightOpen } = useView();
  const byHand = useLive((c) => c.commands.some((k) => !k.plan && isOpen(k.state)));
  const wanted: RightTab = byHand ? "hand" : "step";
  if (!IN_A_PANEL.includes(stage) || (rightOpen && tab === wanted)) return null;
  return (
    <button
      type="button"
      className="button"
      data-testid="way-to-act"
      onClick={() => useView.setState({ tab: wanted, rightOpen: true })}
    >
      {byHand ? "Open By hand" : "Open Step"}
    </button>
  );
}

/** Words of the server's titles that are another word here. */
const VERBS: Record<string, string> = { put: "drop", press: "preload" };

/** Commands that are told by their title. */
const BY_TITLE = new Set([
  "joint_move",
  "wheel_move",
  "body_move",
  "wheel_brake",
  "wheel_roll",
  "wheel_steer",
  "drive_arc",
  "hold",
  "mode",
  "sequence",
  "cancel_rest",
]);

/** `Lift leg 2` → `Send lift to leg 2`. */
export function sendVerb({
  body,
  title,
  plan,
}: Pick<CommandRecord, "body" | "title" | "plan">): string {
  if (body.type === "stop") return "Send stop";
  if (plan?.retreat) {
    return "leg" in body ? `Send way back to ${legLabel(body.leg)}` : "Send body shift back";
  }
  if (BY_TITLE.has(body.type)) return `Send: ${readable(title)}`;
  const word = title.split(" ")[0]?.toLowerCase() ?? "command";
  if (word === "shift" || !("leg" in body)) return "Send body shift";
  return `Send ${VERBS[word] ?? word} to ${legLabel(body.leg)}`;
}

function SendArmed({ command, now }: { command: CommandRecord; now: number }) {
  const clock = commandClock(command, now);
  const blocked = useArmBlocked(command);
  const busy = useRequests((s) => s.busy[command.id]);
  const failure = useRequests((s) => s.failures[command.id]);
  const cancel = useRef<HTMLButtonElement>(null);
  // What was armed can be taken back by the next press: the harmless choice has the focus.
  useEffect(() => cancel.current?.focus({ preventScroll: true }), []);
  const left = clock.armed_s ?? 0;
  return (
    <div className="strip-send">
      {failure && (
        <span className="trouble small" role="alert">
          {failure}
        </span>
      )}
      <Ring left={left / 30} label={`Armed for ${formatSpan(left)} more`} />
      <span className="num strip-left" data-testid="armed-left">
        {formatSpan(left)}
      </span>
      <button
        ref={cancel}
        type="button"
        className="button"
        data-testid="take-back"
        onClick={() => void takeBack(command.id)}
      >
        Take back
      </button>
      <button
        type="button"
        className="button primary send"
        data-testid={`send-${command.plan ? commandName(command.plan) : "hand"}`}
        disabled={blocked !== null || busy}
        title={blocked ?? undefined}
        onClick={() => void sendArmed(command.id)}
      >
        <Send size={16} aria-hidden />
        {sendVerb(command)}
      </button>
    </div>
  );
}
