// Setting the link, and why it was refused.

import { useState } from "react";

import { api, sentenceOf } from "../../api/client";
import type { LinkChange } from "../../api/types";
import { useConsole } from "../../store/console";

export function useLinkChange() {
  const [failure, setFailure] = useState<string | null>(null);
  const [busy, setBusy] = useState(false);
  const replaying = useConsole((s) => s.stream.replayState !== null);
  const connected = useConsole((s) => s.connection === "open");
  const set = async (link: LinkChange): Promise<boolean> => {
    setBusy(true);
    setFailure(null);
    try {
      await api.putLink(link);
      return true;
    } catch (error) {
      setFailure(sentenceOf(error));
      return false;
    } finally {
      setBusy(false);
    }
  };
  return { set, failure, busy, blocked: replaying || !connected };
}
